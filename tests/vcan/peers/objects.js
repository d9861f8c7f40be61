// The device's object dictionary.
'use strict';

const zlib = require('zlib');
const { AccessType, DataType, Eds, ObjectType } = require('canopen');

const { CONSTANT, READ_ONLY, READ_WRITE, WRITE_ONLY } = AccessType;

const MATRIX = 0x2101;
const OFFSET = 0x2102;
const TEMPERATURE_COEFFICIENTS = 0x2103;
const UNLOCK = 0x2104;
const CHECKSUM = 0x2105;
const OUTPUT = 0x2106; // 0: the frames carry compensated readings, 1: raw ones
const RAW = 0x2110;
const COMPENSATED = 0x2111;
const TEMPERATURE = 0x2112;
const SCRATCH = 0x2120; // any bytes: for segmented and block transfers
const HEAD = 0x2130;

// What `save` keeps, in the order in which the checksum takes the calibration.
const CALIBRATION = [MATRIX, OFFSET, TEMPERATURE_COEFFICIENTS];
const STORED = [0x1017, 0x1020, 0x2100, ...CALIBRATION];

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
        const sub = { parameterName: `${name} ${i + 1}`, dataType, accessType, defaultValue: value, ...limits };
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
    const { REAL32, UNSIGNED32, UNSIGNED8, VISIBLE_STRING } = DataType;
    const unit = { lowLimit: -2, highLimit: 2 };
    variable(eds, 0x2100, 'Calibration identity', VISIBLE_STRING, '');
    array(eds, MATRIX, 'Correction matrix', REAL32, [1, 0, 0, 0, 1, 0, 0, 0, 1], READ_WRITE, unit);
    array(eds, OFFSET, 'Offset', REAL32, [0, 0, 0], READ_WRITE, { lowLimit: -0.5, highLimit: 0.5 });
    array(eds, TEMPERATURE_COEFFICIENTS, 'Offset per degC', REAL32, [0, 0, 0], READ_WRITE, { lowLimit: -0.1, highLimit: 0.1 });
    variable(eds, UNLOCK, 'Unlock', UNSIGNED32, 0, WRITE_ONLY);
    variable(eds, CHECKSUM, 'CRC-32 of the calibration', UNSIGNED32, 0, READ_ONLY);
    variable(eds, OUTPUT, 'Raw output', UNSIGNED8, 0, READ_WRITE, { highLimit: 1 });
    variable(eds, SCRATCH, 'Scratch', DataType.OCTET_STRING, '');
}

function streams(eds, { node, event_ms }) {
    const { INTEGER16, UNSIGNED8 } = DataType;
    array(eds, RAW, 'Raw reading', INTEGER16, [0, 0, 0], READ_ONLY);
    array(eds, COMPENSATED, 'Compensated reading', INTEGER16, [0, 0, 0], READ_ONLY);
    variable(eds, TEMPERATURE, 'Temperature, 0.01 degC', INTEGER16, 2500, READ_ONLY);
    array(eds, HEAD, 'CRC, counter and status', UNSIGNED8, [0, 0], READ_ONLY);
    array(eds, HEAD + 1, 'Reading in the frame', INTEGER16, [0, 0, 0], READ_ONLY);
    const reading = [1, 2].map((i) => eds.getSubEntry(HEAD, i)).concat([1, 2, 3].map((i) => eds.getSubEntry(HEAD + 1, i)));
    eds.addTransmitPdo({ cobId: 0x180 + node, transmissionType: 255, eventTime: event_ms, dataObjects: reading });
    eds.addTransmitPdo({ cobId: 0x280 + node, transmissionType: 255, eventTime: 1000, dataObjects: [eds.getEntry(TEMPERATURE)] });
}

function build(options) {
    const eds = new Eds();
    identity(eds, options);
    variable(eds, 0x1017, 'Producer heartbeat time', DataType.UNSIGNED16, options.heartbeat_ms);
    array(eds, 0x1010, 'Store parameters', DataType.UNSIGNED32, [1, 1, 1, 1]);
    array(eds, 0x1011, 'Restore default parameters', DataType.UNSIGNED32, [1, 1, 1, 1]);
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
    const key = (sub) => `${index.toString(16).padStart(4, '0')}:${sub.toString(16).padStart(2, '0')}`;
    return subs.map((sub) => [key(sub), find(eds, index, sub)]);
}

const numbers = (eds, index) => values(eds, index).map(([, entry]) => entry.value);

function checksum(eds) {
    const table = zlib.crc32 ? zlib.crc32 : crc32;
    return table(Buffer.concat(CALIBRATION.flatMap((index) => values(eds, index).map(([, entry]) => entry.raw)))) >>> 0;
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
    CALIBRATION, CHECKSUM, COMPENSATED, HEAD, MATRIX, OFFSET, OUTPUT, RAW, STORED, TEMPERATURE, UNLOCK,
};
