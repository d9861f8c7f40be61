// A CANopen master from the npm package `canopen`: node master.js INTERFACE
// Standard input takes one JSON request a line; standard output gives one JSON answer for each:
//   {"do": "upload", "node": 5, "index": 4120, "sub": 4, "block": false}     -> {"data": "01000000"}
//   {"do": "download", "node": 5, "index": 8450, "sub": 1, "data": "0000803f"} -> {"data": ""}
//   {"do": "nmt", "node": 5, "command": "start"}                              -> {"data": ""}
// Bytes are hexadecimal. A transfer that fails gives {"error": sentence, "code": SDO abort code}.
'use strict';

const readline = require('readline');
const { Device } = require('canopen');
const { createRawChannel } = require('socketcan');

const OWN_ID = 0x7f;
const TIMEOUT_MS = 5000;
const NMT = {
    start: 'startNode', stop: 'stopNode', 'pre-operational': 'enterPreOperational',
    'reset-node': 'resetNode', 'reset-communication': 'resetCommunication',
};

const channel = createRawChannel(process.argv[2]);
const device = new Device({ id: OWN_ID });
const known = new Set();

function address({ node, index, sub = 0, block = false }) {
    if (!known.has(node)) {
        device.eds.addSdoClientParameter(node, 0x600 + node, 0x580 + node);
        known.add(node);
    }
    return { serverId: node, index, subIndex: sub, timeout: TIMEOUT_MS, blockTransfer: block };
}

const actions = {
    upload: (request) => device.sdo.upload(address(request)),
    download: (request) => device.sdo.download({ ...address(request), data: Buffer.from(request.data, 'hex') }),
    nmt: async ({ node, command }) => device.nmt[NMT[command]](node),
};

async function answer(request) {
    try {
        const data = await actions[request.do](request);
        return { data: data ? data.toString('hex') : '' };
    } catch (error) {
        return { error: error.message, code: error.code };
    }
}

device.on('message', (message) => channel.send({ ext: false, rtr: false, ...message }));
channel.addListener('onMessage', (message) => device.receive(message));
channel.start();
device.start();
let queue = Promise.resolve();
readline.createInterface({ input: process.stdin }).on('line', (line) => {
    queue = queue.then(() => answer(JSON.parse(line))).then((result) => process.stdout.write(JSON.stringify(result) + '\n'));
}).on('close', () => process.exit(0));
process.stdout.write(JSON.stringify({ ready: true }) + '\n');
