// The accelerometer behind the bus: what it measures, and its frame with AUTOSAR E2E profile 1 protection.
'use strict';

const INT16 = { low: -32768, high: 32767 };

const multiply = (m, v) => [0, 1, 2].map((i) => m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2]);

// Inverse of a 3 × 3 matrix, row by row, by its adjugate; null when there is none.
function inverse(m) {
    const minor = (i, j) => {
        const [a, b] = [0, 1, 2].filter((k) => k !== i);
        const [c, d] = [0, 1, 2].filter((k) => k !== j);
        return m[3 * a + c] * m[3 * b + d] - m[3 * a + d] * m[3 * b + c];
    };
    const cofactor = (i, j) => ((i + j) % 2 ? -1 : 1) * minor(i, j);
    const determinant = [0, 1, 2].reduce((sum, j) => sum + m[j] * cofactor(0, j), 0);
    if (!(Math.abs(determinant) > 1e-6))
        return null;
    return [0, 1, 2].flatMap((i) => [0, 1, 2].map((j) => cofactor(j, i) / determinant));
}

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

// raw = matrix · true + offset + noise, in g; compensated = M⁻¹ · (raw − o) with the M and o that the station wrote.
class Sensor {
    constructor({ matrix, offset_g, noise_g, lsb_g, seed }) {
        Object.assign(this, { matrix, offset_g, noise_g, lsb_g });
        this.noise = gaussian(seed);
        this.true_g = [0, 0, 1];
    }

    measure(writtenMatrix, writtenOffset) {
        const clean = multiply(this.matrix, this.true_g);
        const counts = (values) => values.map((value) => toCounts(value, this.lsb_g));
        const raw = counts(clean.map((value, i) => value + this.offset_g[i] + this.noise_g * this.noise()));
        const corrector = inverse(writtenMatrix);
        const moved = raw.map((count, i) => count * this.lsb_g - writtenOffset[i]);
        const compensated = corrector ? counts(multiply(corrector, moved)) : raw;
        return { raw, compensated };
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
