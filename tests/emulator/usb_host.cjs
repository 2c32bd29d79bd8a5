// A USB host, and the RP2040's controller between it and the program, by the data sheet [4.1.2] and USB 2.0. It takes the
// place of rp2040js's own, which hands on every buffer at once and looks at neither toggles, stalls nor addresses.
"use strict";

const FRAME_NS = 1000000;
const POLL_NS = 20000; // between two attempts that the device refuses
const PATIENCE_NS = 50e6;
const LATEST_US = 805; // of a frame, to hand over a bulk packet: erratum RP2040-E15; 5 µs for the way from check to hand-over
const AVAILABLE = 1 << 10;
const STALL = 1 << 11;
const DATA1 = 1 << 13;
const FULL = 1 << 15;
const LENGTH = 0x3ff;
const ENABLED = 0x80000000;
const SETUP_REC = 1 << 17;
const BUS_RESET = 1 << 19;
const SUSPENDED = 1 << 4;
const INT_DEV_SOF = 1 << 17;
const PULLED_UP = 1 << 16;
const SOF_RD = 0x48;

class UsbHost {
    constructor(chip, say) {
        this.chip = chip;
        this.say = say;
        this.usb = chip.usbCtrl;
        this.memory = chip.usbDPRAMView;
        this.reads = true;
        this.waiting = [];
        this.usb.DPRAMUpdated = (offset, value) => this.written(offset, value);
        const read = this.usb.readUint32.bind(this.usb);
        this.usb.readUint32 = (offset) => {
            if (offset === SOF_RD) this.interrupt(INT_DEV_SOF, false);
            return read(offset);
        };
        this.unplug();
        this.frame();
    }

    complain(text) {
        this.say(`complaint ${text}`);
    }

    after(ns, action) {
        this.chip.clock.createAlarm(action).schedule(ns);
    }

    interrupt(bit, on) {
        this.usb.intRaw = on ? this.usb.intRaw | bit : this.usb.intRaw & ~bit;
        this.usb.checkInterrupts();
    }

    status(bit, on) {
        this.usb.sieStatus = on ? this.usb.sieStatus | bit : this.usb.sieStatus & ~bit;
        this.usb.sieStatusUpdated();
    }

    // With the chip: the pull-up goes, so the host takes the device for unplugged.
    resetController() {
        Object.assign(this.usb, { mainCtrl: 0, sieCtrl: 0, sieStatus: 0, buffStatus: 0, intRaw: 0, intEnable: 0, epStallArm: 0 });
        this.usb.checkInterrupts();
        this.unplug();
    }

    unplug() {
        this.plugged = false;
        this.run = null;
        this.armed = new Map();
        this.toggles = new Map();
        this.address = 0;
        this.usb.sieStatus |= SUSPENDED;
        this.usb.addrEndp = 0;
    }

    plug() {
        if (!(this.usb.sieCtrl & PULLED_UP)) this.complain("the device does not pull its line up");
        this.plugged = true;
        this.start(this.enumerate());
    }

    // A script: it yields nanoseconds to wait.
    start(script) {
        this.run = script;
        const next = () => {
            if (this.run !== script) return;
            const step = script.next();
            if (!step.done) this.after(step.value, next);
            else if (this.waiting.length > 0) this.start(this.waiting.shift());
            else this.start(this.listen());
        };
        next();
    }

    frame() {
        this.after(FRAME_NS, () => this.frame());
        if (!this.plugged) return;
        this.usb.sofFrameNumber = (this.usb.sofFrameNumber + 1) & 0x7ff;
        this.frameBegan = this.chip.clock.nanos;
        this.interrupt(INT_DEV_SOF, true);
    }

    place(endpoint, out) {
        return 0x80 + 8 * endpoint + (out ? 4 : 0);
    }

    // The program has written a buffer control register.
    written(offset, value) {
        if (offset < 0x80 || offset > 0xfc) return;
        const endpoint = (offset - 0x80) >> 3;
        const out = (offset & 4) !== 0;
        const name = `${endpoint} ${out}`;
        if (!(value & AVAILABLE)) {
            this.armed.set(name, { value, ready: false });
            return;
        }
        const before = this.armed.get(name);
        if (!before || before.ready || before.value !== (value & ~AVAILABLE))
            this.complain(`endpoint ${name}: a buffer is handed over in the same write as its content`);
        if (!out && !(value & FULL)) this.complain(`endpoint ${name}: an empty buffer is handed over`);
        const late_us = (this.chip.clock.nanos - this.frameBegan) / 1000;
        if (!out && endpoint > 0 && late_us > LATEST_US && late_us < 1000)
            this.complain(`a packet is handed over ${late_us.toFixed(0)} us after the frame began`);
        this.armed.set(name, { value, ready: true });
    }

    buffer(endpoint, out) {
        if (endpoint === 0) return 0x100;
        const control = this.memory.getUint32(8 * endpoint + (out ? 4 : 0), true);
        if (!(control & ENABLED)) this.complain(`endpoint ${endpoint} is not enabled`);
        return control & 0xffc0;
    }

    finished(endpoint, out, value) {
        this.armed.set(`${endpoint} ${out}`, { value, ready: false });
        this.memory.setUint32(this.place(endpoint, out), value, true);
        this.usb.indicateBufferReady(endpoint, out);
    }

    // One attempt. undefined: the device is not ready; null: it refuses.
    tryIn(endpoint) {
        const armed = this.armed.get(`${endpoint} false`);
        if (armed && armed.value & STALL && (endpoint > 0 || this.usb.epStallArm & 1)) return null;
        if (!armed || !armed.ready || this.usb.addrEndp !== this.address) return undefined;
        const count = armed.value & LENGTH;
        const place = this.buffer(endpoint, false);
        const data = [...this.chip.usbDPRAM.slice(place, place + count)];
        this.toggle(endpoint, false, armed.value);
        this.finished(endpoint, false, armed.value & ~(AVAILABLE | FULL));
        return data;
    }

    tryOut(endpoint, data) {
        const armed = this.armed.get(`${endpoint} true`);
        if (armed && armed.value & STALL && (endpoint > 0 || this.usb.epStallArm & 2)) return null;
        if (!armed || !armed.ready || this.usb.addrEndp !== this.address) return undefined;
        if (data.length > (armed.value & LENGTH)) this.complain(`endpoint ${endpoint} has no room for ${data.length} bytes`);
        this.toggle(endpoint, true, armed.value);
        this.chip.usbDPRAM.set(data, this.buffer(endpoint, true));
        this.finished(endpoint, true, (armed.value & ~(AVAILABLE | LENGTH)) | FULL | data.length);
        return true;
    }

    toggle(endpoint, out, value) {
        const name = `${endpoint} ${out}`;
        const expected = this.toggles.get(name) || 0;
        if (((value & DATA1) !== 0) !== (expected === 1)) this.complain(`endpoint ${name}: DATA${expected} was expected`);
        this.toggles.set(name, 1 - expected);
    }

    *attempt(action) {
        const end = this.chip.clock.nanos + PATIENCE_NS;
        while (this.chip.clock.nanos < end) {
            const result = action();
            if (result !== undefined) return result;
            yield POLL_NS;
        }
        this.complain("the device did not answer");
        return null;
    }

    // A control transfer. The answer: bytes, or null where the device refuses.
    *control(type, request, value, index, size, data = []) {
        const setup = [type, request, value & 0xff, value >> 8, index & 0xff, index >> 8, size & 0xff, size >> 8];
        if (this.usb.addrEndp !== this.address) this.complain(`the device answers at ${this.usb.addrEndp}`);
        this.chip.usbDPRAM.set(setup, 0);
        this.usb.epStallArm = 0; // [4.1.2.5.2] a setup packet clears it
        this.toggles.set("0 false", 1);
        this.toggles.set("0 true", 1);
        this.status(SETUP_REC, true);
        yield POLL_NS;
        if (type & 0x80) {
            const answer = [];
            for (;;) {
                const packet = yield* this.attempt(() => this.tryIn(0));
                if (packet === null) return null;
                answer.push(...packet);
                if (packet.length < 64 || answer.length >= size) break;
                yield POLL_NS;
            }
            if (answer.length > size) this.complain(`${answer.length} bytes where ${size} were asked for`);
            yield* this.attempt(() => this.tryOut(0, []));
            return answer;
        }
        if (data.length > 0 && (yield* this.attempt(() => this.tryOut(0, data))) === null) return null;
        const confirmed = yield* this.attempt(() => this.tryIn(0));
        if (confirmed !== null && confirmed.length > 0) this.complain("a confirmation is not empty");
        return confirmed;
    }

    // As Linux does it.
    *enumerate() {
        const found = {};
        this.status(SUSPENDED, false);
        for (let round = 0; round < 2; round++) {
            this.toggles.clear();
            this.address = 0;
            this.status(BUS_RESET, true);
            yield 10e6;
            if (round === 0) found.first = yield* this.control(0x80, 6, 0x0100, 0, 64);
        }
        yield* this.control(0, 5, 23, 0, 0);
        this.address = 23;
        yield 2e6;
        found.device = yield* this.control(0x80, 6, 0x0100, 0, 18);
        found.qualifier = yield* this.control(0x80, 6, 0x0600, 0, 10);
        found.head = yield* this.control(0x80, 6, 0x0200, 0, 9);
        found.configuration = yield* this.control(0x80, 6, 0x0200, 0, 255);
        found.strings = [];
        for (let number = 0; number < 5; number++)
            found.strings.push(yield* this.control(0x80, 6, 0x0300 | number, number ? 0x0409 : 0, 255));
        found.configured = yield* this.control(0, 9, 1, 0, 0);
        found.state = yield* this.control(0x80, 8, 0, 0, 1);
        found.coded = yield* this.control(0x21, 0x20, 0, 0, 7, [0x00, 0x08, 0x07, 0, 0, 0, 8]);
        found.coding = yield* this.control(0xa1, 0x21, 0, 0, 7);
        found.unknown = yield* this.control(0x21, 0x7f, 0, 0, 0);
        this.say(`found ${JSON.stringify(found)}`);
    }

    *opened(isOpen) {
        if ((yield* this.control(0x21, 0x22, isOpen ? 3 : 0, 0, 0)) === null) this.complain("the port cannot be opened");
    }

    *send(bytes) {
        for (let place = 0; place < bytes.length; place += 64) {
            yield* this.attempt(() => this.tryOut(2, bytes.slice(place, place + 64)));
            yield POLL_NS;
        }
    }

    *listen() {
        let read = [];
        while (this.waiting.length === 0) {
            const packet = this.reads ? this.tryIn(2) : undefined;
            if (packet) {
                read.push(...packet);
                // What a driver hands on: its buffer is full, or a packet was short.
                if (packet.length < 64 || read.length >= 128) {
                    this.say(`over-usb ${read.join(" ")}`);
                    read = [];
                }
            }
            yield POLL_NS;
        }
        if (read.length > 0) this.say(`over-usb ${read.join(" ")}`);
    }

    order(script) {
        this.waiting.push(script);
    }
}

module.exports = { UsbHost };
