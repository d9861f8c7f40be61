// The device's object dictionary.
'use strict';

const zlib = require('zlib');
const { AccessType, DataType, Eds, ObjectType } = require('canopen');

const { CONSTANT, READ_ONLY, READ_WRITE, WRITE_ONLY } = AccessType;

const RECORD = 0x2100; // the station's name for its record of the calibration
const MATRIX = 0x2101; // forward: measured = matrix · true + offset
const OFFSET = 0x2102;
const AT_TEMPERATURE = 0x2103;
const UNLOCK = 0x2104;
const CHECKSUM = 0x2105; // of matrix and offset
const OUTPUT = 0x2106; // 0: the frames carry raw readings, 1: compensated ones where the calibration is valid
const VALID = 0x2107;
const RAW = 0x2110;
const COMPENSATED = 0x2111;
const TEMPERATURE = 0x2112;
const PAYLOAD = 0x2113; // what the frame carries: CRC, counter and status, X, Y, Z
const SCRATCH = 0x2120; // any bytes, for segmented and block transfers; not in the product's EDS
const READINGS = 0x1800;

const LOCKED = [0x1020, RECORD, MATRIX, OFFSET, AT_TEMPERATURE, VALID];
const STORED = [0x1017, READINGS, READINGS + 1, OUTPUT, ...LOCKED];
const LONGEST_RECORD = 36;

// The package makes the mandatory entries itself, with values of its own.
function add(eds, index, data) {
    if (eds.getEntry(index))
        eds.removeEntry(index);
    return eds.addEntry(index, data);
}

function variable(eds, index, name, dataType, value, accessType = READ_WRITE, limits = {}) {
    const entry = add(eds, index, { parameterName: name, dataType, accessType, defaultValue: value, ...limits });
    entry.value = value;
}

function array(eds, index, name, dataType, values, accessType = READ_WRITE, limits = {}) {
    const entry = add(eds, index, { parameterName: name, objectType: ObjectType.ARRAY });
    entry.at(0).accessType = CONSTANT;
    values.forEach((value, i) => {
        const type = Array.isArray(dataType) ? dataType[i] : dataType;
        const sub = { parameterName: `${name} ${i + 1}`, dataType: type, accessType, defaultValue: value, ...limits };
        entry.addSubObject(i + 1, sub).value = value;
    });
}

function identity(eds, { device_type, vendor, product, revision, serial, name, hardware, software }) {
    variable(eds, 0x1000, 'Device type', DataType.UNSIGNED32, device_type, READ_ONLY);
    variable(eds, 0x1001, 'Error register', DataType.UNSIGNED8, 0, READ_ONLY);
    variable(eds, 0x1008, 'Manufacturer device name', DataType.VISIBLE_STRING, name, CONSTANT);
    variable(eds, 0x1009, 'Manufacturer hardware version', DataType.VISIBLE_STRING, hardware, CONSTANT);
    variable(eds, 0x100a, 'Manufacturer software version', DataType.VISIBLE_STRING, software, CONSTANT);
    array(eds, 0x1018, 'Identity', DataType.UNSIGNED32, [vendor, product, revision, serial], READ_ONLY);
}

function calibration(eds) {
    const { OCTET_STRING, REAL32, UNSIGNED32, UNSIGNED8, VISIBLE_STRING } = DataType;
    const within = (lowLimit, highLimit) => ({ lowLimit, highLimit });
    variable(eds, RECORD, 'Calibration record', VISIBLE_STRING, '');
    array(eds, MATRIX, 'Calibration matrix', REAL32, [1, 0, 0, 0, 1, 0, 0, 0, 1], READ_WRITE, within(-1.5, 1.5));
    array(eds, OFFSET, 'Calibration offset', REAL32, [0, 0, 0], READ_WRITE, within(-0.5, 0.5));
    variable(eds, AT_TEMPERATURE, 'Calibration temperature', REAL32, 20, READ_WRITE, within(-40, 125));
    variable(eds, UNLOCK, 'Unlock', UNSIGNED32, 0, WRITE_ONLY);
    variable(eds, CHECKSUM, 'Checksum of the coefficients', UNSIGNED32, 0, READ_ONLY);
    variable(eds, OUTPUT, 'Output mode', UNSIGNED8, 1, READ_WRITE, within(0, 1));
    variable(eds, VALID, 'Calibration valid', UNSIGNED8, 0, READ_WRITE, within(0, 1));
    variable(eds, SCRATCH, 'Scratch', OCTET_STRING, '');
}

function streams(eds, { node, event_ms }) {
    const { INTEGER16, UNSIGNED8 } = DataType;
    array(eds, RAW, 'Raw reading', INTEGER16, [0, 0, 0], READ_ONLY);
    array(eds, COMPENSATED, 'Compensated reading', INTEGER16, [0, 0, 0], READ_ONLY);
    variable(eds, TEMPERATURE, 'Temperature, 0.01 degC', INTEGER16, 2500, READ_ONLY);
    array(eds, PAYLOAD, 'Frame', [UNSIGNED8, UNSIGNED8, INTEGER16, INTEGER16, INTEGER16], [0, 0, 0, 0, 0], READ_ONLY);
    const reading = [1, 2, 3, 4, 5].map((i) => find(eds, PAYLOAD, i));
    const pdo = (cobId, eventTime, dataObjects) =>
        eds.addTransmitPdo({ cobId, transmissionType: 255, eventTime, dataObjects }, { saveDefault: true });
    pdo(0x180 + node, event_ms, reading);
    pdo(0x280 + node, 1000, [eds.getEntry(TEMPERATURE)]);
}

function build(options) {
    const eds = new Eds();
    identity(eds, options);
    variable(eds, 0x1017, 'Producer heartbeat time', DataType.UNSIGNED16, options.heartbeat_ms);
    array(eds, 0x1010, 'Store parameters', DataType.UNSIGNED32, [1]);
    array(eds, 0x1011, 'Restore default parameters', DataType.UNSIGNED32, [1]);
    array(eds, 0x1020, 'Verify configuration', DataType.UNSIGNED32, [0, 0]);
    eds.addSdoServerParameter(0, 0x580 + options.node, 0x600 + options.node);
    calibration(eds);
    streams(eds, options);
    return eds;
}

// The entry that a client means, or undefined; an array's sub-objects are entries of their own.
function find(eds, index, sub) {
    const entry = eds.getEntry(index);
    return entry && entry.subNumber > 0 ? entry.at(sub) : sub === 0 ? entry : undefined;
}

// Every value of an index: [key, entry] with keys like 2101:01.
function values(eds, index) {
    const entry = eds.getEntry(index);
    const count = entry.subNumber > 0 ? entry.at(0).value : 0;
    const subs = count ? Array.from({ length: count }, (_, i) => i + 1) : [0];
    const hex = (number, digits) => number.toString(16).toUpperCase().padStart(digits, '0');
    const key = (sub) => `${hex(index, 4)}:${hex(sub, 2)}`;
    return subs.map((sub) => [key(sub), find(eds, index, sub)]);
}

const numbers = (eds, index) => values(eds, index).map(([, entry]) => entry.value);

function checksum(eds) {
    const table = zlib.crc32 ? zlib.crc32 : crc32;
    return table(Buffer.concat([MATRIX, OFFSET].flatMap((index) => values(eds, index).map(([, entry]) => entry.raw)))) >>> 0;
}

// For a Node older than 22.2, whose zlib does not show it.
function crc32(bytes) {
    let crc = 0xffffffff;
    for (const byte of bytes) {
        crc ^= byte;
        for (let bit = 0; bit < 8; ++bit)
            crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
    }
    return crc ^ 0xffffffff;
}

module.exports = {
    build, checksum, find, numbers, values,
    CHECKSUM, COMPENSATED, LOCKED, LONGEST_RECORD, MATRIX, OFFSET, OUTPUT, PAYLOAD, RAW, READINGS, RECORD, STORED,
    TEMPERATURE, UNLOCK, VALID,
};
