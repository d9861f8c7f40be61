// What the device keeps without power, and objects 0x1010 and 0x1011, which the package leaves to us.
'use strict';

const fs = require('fs');
const objects = require('./objects');

class Flash {
    // path: a file that outlives the process, or null. It holds {"objects": {"2101:01": 1.0, ...}} as last saved.
    constructor(path) {
        this.path = path;
        this.kept = path && fs.existsSync(path) ? JSON.parse(fs.readFileSync(path)).objects : {};
        this.restoring = false;
    }

    save(eds) {
        const pairs = objects.STORED.flatMap((index) => objects.values(eds, index));
        this.kept = Object.fromEntries(pairs.map(([key, entry]) => [key, entry.value]));
        this.restoring = false;
        this.write();
    }

    // The values come back to their defaults at the next reset only.
    restore() {
        this.restoring = true;
    }

    powerUp(eds) {
        if (this.restoring) {
            this.kept = {};
            this.restoring = false;
            this.write();
        }
        for (const [key, entry] of objects.STORED.flatMap((index) => objects.values(eds, index))) {
            entry.value = this.kept[key] ?? entry.defaultValue;
        }
    }

    write() {
        if (this.path)
            fs.writeFileSync(this.path, JSON.stringify({ objects: this.kept }));
    }
}

module.exports = { Flash };
