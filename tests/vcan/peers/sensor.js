// The accelerometer behind the bus: what it measures, and its frame with AUTOSAR E2E profile 1 protection.
'use strict';

const INT16 = { low: -32768, high: 32767 };

const multiply = (m, v) => [0, 1, 2].map((i) => m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2]);
const toCounts = (value, lsb) => Math.min(INT16.high, Math.max(INT16.low, Math.round(value / lsb)));

// mulberry32: a uniform number in [0, 1) from a seed, the same on every machine.
function uniform(seed) {
    let state = seed >>> 0;
    return () => {
        state = (state + 0x6d2b79f5) >>> 0;
        let t = Math.imul(state ^ (state >>> 15), state | 1);
        t = (t + Math.imul(t ^ (t >>> 7), t | 61)) ^ t;
        return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
    };
}

function gaussian(seed) {
    const next = uniform(seed);
    return () => Math.sqrt(-2 * Math.log(1 - next())) * Math.cos(2 * Math.PI * next());
}

// raw = matrix · true + offset + noise, in g; compensated = M · (raw − o) with the M and o that the station wrote.
class Sensor {
    constructor({ matrix, offset_g, noise_g, lsb_g, seed }) {
        Object.assign(this, { matrix, offset_g, noise_g, lsb_g });
        this.noise = gaussian(seed);
        this.true_g = [0, 0, 1];
        this.temperature_degC = 25;
    }

    measure(correctionMatrix, correctionOffset) {
        const clean = multiply(this.matrix, this.true_g);
        const raw = clean.map((value, i) => value + this.offset_g[i] + this.noise_g * this.noise());
        const compensated = multiply(correctionMatrix, raw.map((value, i) => value - correctionOffset[i]));
        const counts = (values) => values.map((value) => toCounts(value, this.lsb_g));
        return { raw: counts(raw), compensated: counts(compensated), temperature: toCounts(this.temperature_degC, 0.01) };
    }
}

// CRC-8 with polynomial 0x1D over the 16-bit data id, low byte first, then the frame without its CRC byte.
// As the profile lays it down the start value cancels the library's: net start 0x00, final XOR 0x00.
function crcE2eP01(dataId, bytes) {
    let crc = 0;
    for (const byte of [dataId & 0xff, dataId >> 8, ...bytes]) {
        crc ^= byte;
        for (let bit = 0; bit < 8; ++bit)
            crc = crc & 0x80 ? ((crc << 1) ^ 0x1d) & 0xff : crc << 1;
    }
    return crc;
}

// The first two bytes of the frame: CRC, then counter (low nibble, 0–14) and status (high nibble).
// The axes X Y Z follow as int16, low byte first. Status bit 1: an axis is clipped; bit 2: compensated.
function protectedHead(dataId, counter, compensated, axes) {
    const clipped = axes.some((value) => value === INT16.low || value === INT16.high);
    const body = Buffer.alloc(7);
    body.writeUInt8((((compensated ? 4 : 0) | (clipped ? 2 : 0)) << 4) | counter, 0);
    axes.forEach((value, i) => body.writeInt16LE(value, 1 + 2 * i));
    return { crc: crcE2eP01(dataId, body), counterAndStatus: body[0] };
}

module.exports = { Sensor, protectedHead };
