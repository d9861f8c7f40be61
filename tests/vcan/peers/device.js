// An accelerometer on CANopen, served by the npm package `canopen`: node device.js INTERFACE '{"node": 5, ...}'
// Standard input takes one JSON order a line, standard output gives one JSON event a line; see README.md.
'use strict';

const readline = require('readline');
const { Device, NmtState } = require('canopen');
const { createRawChannelWithOptions } = require('socketcan');
const { Door } = require('./door');
const { Flash } = require('./flash');
const objects = require('./objects');
const { Sensor, protectedHead } = require('./sensor');

const DEFAULTS = {
    node: 1, device_type: 0x20194, vendor: 0xca1b0, product: 0xacc, revision: 0x10001, serial: 1,
    name: 'accelerometer', hardware: 'Node', software: 'canopen 6.2.1',
    matrix: [1, 0, 0, 0, 1, 0, 0, 0, 1], offset_g: [0, 0, 0], noise_g: 0.0005, lsb_g: 1 / 16000, seed: 1,
    event_ms: 10, heartbeat_ms: 500, flash: null, flash_ms: 50, unlock_code: 0x4c414331,
};

const [, , channelName, given] = process.argv;
const options = { ...DEFAULTS, ...JSON.parse(given || '{}') };
const { node } = options;

const say = (event) => process.stdout.write(JSON.stringify(event) + '\n');
const channel = createRawChannelWithOptions(channelName, { non_block_send: true });
const eds = objects.build(options);
const device = new Device({ id: node, eds });
const flash = new Flash(options.flash);
const sensor = new Sensor(options);
const faults = { late_ms: 0, twice: false };

function transmit({ id, data }) {
    try {
        channel.send({ id, data, ext: false, rtr: false });
    } catch (error) {
        say({ event: 'send-failed', message: error.message });
    }
}

// The one transmit hook. Two of them would send every answer twice, which is the fault `twice`.
function send(message) {
    const isAnswer = message.id === 0x580 + node;
    const times = isAnswer && faults.twice ? 2 : 1;
    for (let i = 0; i < times; ++i) {
        if (isAnswer && faults.late_ms)
            setTimeout(transmit, faults.late_ms, message);
        else
            transmit(message);
    }
}

const door = new Door({ ...options, eds, flash, send, say, receive: (message) => device.receive(message) });

let counter = 0;
function sample() {
    const isOn = (index) => eds.getEntry(index).value === 1;
    const compensated = isOn(objects.OUTPUT) && isOn(objects.VALID);
    const reading = sensor.measure(objects.numbers(eds, objects.MATRIX), objects.numbers(eds, objects.OFFSET));
    const shown = compensated ? reading.compensated : reading.raw;
    const head = protectedHead(0x1a00 + node, counter, compensated, shown);
    counter = (counter + 1) % 15;
    const fill = (index, numbers) => numbers.forEach((value, i) => (eds.getSubEntry(index, i + 1).value = value));
    fill(objects.RAW, reading.raw);
    fill(objects.COMPENSATED, reading.compensated);
    fill(objects.PAYLOAD, [head.crc, head.counterAndStatus, ...shown]);
}

let timers = [];
function stream() {
    timers.forEach(clearInterval);
    if (device.state !== NmtState.OPERATIONAL)
        return;
    const period = (index) => eds.getSubEntry(index, 5).value; // ms; 0 stops it
    const every = (index, action) => (period(index) ? setInterval(action, period(index)) : null);
    const write = (cobId) => device.pdo.write(cobId);
    write(0x280 + node);
    timers = [
        every(objects.READINGS, () => (sample(), write(0x180 + node))),
        every(objects.READINGS + 1, () => write(0x280 + node)),
    ];
}

let state = NmtState.INITIALIZING;
device.nmt.on('changeState', (next) => {
    timers.forEach(clearInterval);
    timers = [];
    if (state === NmtState.INITIALIZING && next === NmtState.PRE_OPERATIONAL)
        powerUp();
    if (next === NmtState.OPERATIONAL)
        setImmediate(stream); // the package starts its PDOs after this listener
    state = next;
    say({ event: 'state', state: next });
});

// Runs at the start and after a reset: what is stored comes back, and the boot-up message goes out.
function powerUp() {
    flash.powerUp(eds);
    door.powerUp();
    refreshChecksum();
    send({ id: 0x700 + node, data: Buffer.from([0]) });
    say({ event: 'boot-up' });
}

function refreshChecksum() {
    eds.getEntry(objects.CHECKSUM).value = objects.checksum(eds);
}

const orders = {
    turn: ({ true_g }) => (sensor.true_g = true_g),
    warm: ({ temperature_degC }) => (eds.getEntry(objects.TEMPERATURE).value = Math.round(100 * temperature_degC)),
    fault: ({ silent = false, refuse = {}, late_ms = 0, twice = false }) => {
        Object.assign(door.faults, { silent, refuse });
        Object.assign(faults, { late_ms, twice });
    },
    reboot: () => device.nmt.resetNode(),
    stop: () => process.exit(0),
};

for (const index of [objects.MATRIX, objects.OFFSET])
    eds.getEntry(index).on('update', refreshChecksum);
for (const index of [objects.READINGS, objects.READINGS + 1])
    eds.getEntry(index).on('update', () => setImmediate(stream));
device.on('message', send);
channel.addListener('onMessage', (message) => door.take(message));
channel.start();
device.start();
readline.createInterface({ input: process.stdin }).on('line', (line) => {
    const order = JSON.parse(line);
    orders[order.order](order);
    say({ event: 'done', order: order.order });
}).on('close', () => process.exit(0));
say({ event: 'ready', node });
