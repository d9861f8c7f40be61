// Stands before the package's SDO server: the checks that it lacks, save and restore, and faults on demand.
'use strict';

const objects = require('./objects');

const ABORT = {
    LENGTH: 0x06070010, LONG: 0x06070012, VALUE: 0x06090030, SIGNATURE: 0x08000020, STATE: 0x08000022,
};
const SAVE = 0x65766173;
const LOAD = 0x64616f6c;
const FIXED_TYPES = new Set([0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x08]);
const REAL32 = 0x08;

const isInitiateDownload = (data) => data[0] >> 5 === 1;
const isExpedited = (data) => (data[0] & 2) !== 0;

class Door {
    // receive: hands a frame to the package; send: puts a frame on the bus; say: tells the test.
    constructor({ eds, flash, node, flash_ms, unlock_code, receive, send, say }) {
        Object.assign(this, { eds, flash, node, flash_ms, unlock_code, receive, send, say });
        this.faults = { silent: false, refuse: {} };
        this.powerUp();
    }

    powerUp() {
        this.locked = this.unlock_code !== 0;
        this.busy = false;
    }

    // One frame from the bus; only requests to this node's SDO server are looked at.
    take(message) {
        if (message.id !== 0x600 + this.node || message.data.length < 8)
            return this.receive(message);
        if (this.faults.silent)
            return undefined;
        const data = message.data;
        if (!isInitiateDownload(data))
            return this.busy ? this.abort(data, ABORT.STATE) : this.receive(message);
        const code = this.refusal(data);
        if (code)
            return this.abort(data, code);
        return this.command(data) || this.receive(message);
    }

    refusal(data) {
        const index = data.readUInt16LE(1);
        const entry = objects.find(this.eds, index, data[3]);
        if (this.busy)
            return ABORT.STATE;
        if (this.faults.refuse[index])
            return this.faults.refuse[index];
        if (this.locked && objects.LOCKED.includes(index))
            return ABORT.STATE;
        if (index === objects.RECORD && !isExpedited(data) && data.readUInt32LE(4) > objects.LONGEST_RECORD)
            return ABORT.LONG;
        if (!entry || !FIXED_TYPES.has(entry.dataType))
            return 0; // the package knows what to say
        return this.misfit(data, entry);
    }

    misfit(data, entry) {
        const segmented = !isExpedited(data);
        const sized = (data[0] & 1) !== 0;
        const length = segmented ? (sized ? data.readUInt32LE(4) : entry.raw.length) : sized ? 4 - ((data[0] >> 2) & 3) : 4;
        if (segmented || length !== entry.raw.length)
            return ABORT.LENGTH;
        return entry.dataType === REAL32 && !Number.isFinite(data.readFloatLE(4)) ? ABORT.VALUE : 0;
    }

    // Objects whose writing does something; true when the answer is ours to give.
    command(data) {
        const [index, value] = [data.readUInt16LE(1), data.readUInt32LE(4)];
        if (index === 0x1010 || index === 0x1011)
            return this.store(data, index, value);
        if (index === objects.UNLOCK) {
            this.locked = this.unlock_code !== 0 && value !== this.unlock_code;
            return this.locked ? this.abort(data, ABORT.SIGNATURE) : this.confirm(data);
        }
        return false;
    }

    store(data, index, value) {
        if (value !== (index === 0x1010 ? SAVE : LOAD) || !objects.find(this.eds, index, data[3]))
            return this.abort(data, ABORT.SIGNATURE);
        this.busy = true;
        setTimeout(() => {
            this.busy = false;
            if (index === 0x1010)
                this.flash.save(this.eds);
            else
                this.flash.restore();
            this.say({ event: index === 0x1010 ? 'saved' : 'restoring' });
            this.confirm(data);
        }, this.flash_ms);
        return true;
    }

    confirm(data) {
        this.answer([0x60, data[1], data[2], data[3], 0, 0, 0, 0]);
        return true;
    }

    abort(data, code) {
        const tail = Buffer.alloc(4);
        tail.writeUInt32LE(code);
        this.answer([0x80, data[1], data[2], data[3], ...tail]);
        this.say({ event: 'aborted', index: data.readUInt16LE(1), sub: data[3], code });
        return true;
    }

    answer(bytes) {
        this.send({ id: 0x580 + this.node, data: Buffer.from(bytes) });
    }
}

module.exports = { Door };
