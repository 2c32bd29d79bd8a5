// An RP2040 of rp2040js that runs an image of flash. What hangs on its pins is elsewhere: each event is a line on standard
// output, those that need an answer wait for a line on standard input. The others wait for one that needs an answer, since
// each handing over costs as much as a hundred emulated instructions. usage: node rp2040_chip.cjs RP2040JS IMAGE
"use strict";
const fs = require("fs");
const { addFlash } = require("./spi_flash.cjs");
const { UsbHost } = require("./usb_host.cjs");
const [, , library, image] = process.argv;
const { RP2040 } = require(library);

const CYCLE_NS = 8; // 125 MHz
const BYTE_NS = 22500; // eight bits and an acknowledgement at 400 kHz
const BIT_NS = 2500;
const HANG_PATIENCE_NS = 10e6;
const BOOT2 = 0x20041f00; // where the ROM copies it
const FLASH_ID = [0xe6, 0x61, 0x38, 0x52, 0x83, 0x0a, 0x5c, 0x21];

let input = "";
let output = "";
function say(line) {
    output += line + "\n";
}
function ask(line) {
    say(line);
    for (let rest = Buffer.from(output); rest.length > 0; ) rest = rest.subarray(fs.writeSync(1, rest));
    output = "";
    while (!input.includes("\n")) {
        const chunk = Buffer.alloc(4096);
        const count = fs.readSync(0, chunk, 0, chunk.length, null);
        if (count === 0) process.exit(0);
        input += chunk.toString("latin1", 0, count);
    }
    const end = input.indexOf("\n");
    const answer = input.slice(0, end);
    input = input.slice(end + 1);
    return answer;
}

const chip = new RP2040();
const seconds = () => (chip.clock.nanos * 1e-9).toFixed(9);
const warnings = new Set();
chip.logger = {
    debug() {},
    info() {},
    warn: (name, text) => warnings.add(`${name}: ${text}`),
    error: (name, text) => warnings.add(`${name}: ${text}`),
};
const flash = fs.readFileSync(image);

function after(ns, action) {
    chip.clock.createAlarm(action).schedule(ns);
}

chip.i2c.forEach((port, number) => {
    let answered = false; // whoever answers to its address takes every byte
    port.onStart = () => after(BIT_NS, () => port.completeStart());
    port.onConnect = (address, mode) =>
        after(BYTE_NS, () => {
            answered = ask(`start ${seconds()} ${number} ${address} ${mode}`) === "1";
            port.completeConnect(answered);
        });
    port.onWriteByte = (value) =>
        after(BYTE_NS, () => {
            say(`put ${seconds()} ${number} ${value}`);
            port.completeWrite(answered);
        });
    port.onReadByte = () => after(BYTE_NS, () => port.completeRead(Number(ask(`get ${seconds()} ${number}`))));
    port.onStop = () =>
        after(BIT_NS, () => {
            say(`stop ${seconds()} ${number}`);
            port.completeStop();
        });
});
chip.gpio[11].addListener((state) => chip.gpio[10].setInputValue(ask(`clock ${seconds()} ${state === 1 ? 1 : 0}`) === "1"));
function watchData() {
    chip.gpio[10].setInputValue(ask(`data ${seconds()}`) === "1");
    after(500000, watchData);
}
chip.uart[0].onByte = (value) => say(`sent ${value}`);
chip.uart[0].onBaudRateChange = (baud) => say(`baud ${baud}`);
let resets = false; // after the instruction that runs now
chip.peripherals[0x40058].onWatchdogTrigger = () => {
    chip.peripherals[0x40058].writeUint32(0, 0); // its own reset, which rp2040js leaves to us
    resets = true;
};

// What a reset does to the core [ARMv6-M B1.5.5], but for the program's start; rp2040js leaves all of it as it was. A
// handler that was running would keep every interrupt from the program that starts.
function resetCore() {
    const THREAD = 0;
    Object.assign(chip.core, { currentMode: THREAD, IPSR: 0, PM: false, enabledInterrupts: 0, pendingInterrupts: 0, VTOR: 0 });
}

function start() {
    const nanos = chip.clock.nanos;
    resetCore();
    chip.reset();
    host.resetController();
    chip.flash.set(flash);
    chip.clock.nanosCounter = nanos;
    chip.sram.set(flash.subarray(0, 256), BOOT2 - 0x20000000);
    chip.core.PC = BOOT2;
    // pull-ups: of a Pico's pins, and of a QT Py's
    for (const pin of [4, 5, 6, 7, 8, 9, 22, 23, 24, 25, 26, 27]) chip.gpio[pin].setInputValue(true);
}

function step() {
    chip.clock.tick(chip.core.executeInstruction() * CYCLE_NS);
    if (resets) {
        resets = false;
        start();
    }
}

// An endless loop in place of what runs next in an interrupt's handler, or outside of all.
function hang(inHandler) {
    const patience = chip.clock.nanos + HANG_PATIENCE_NS;
    while ((chip.core.IPSR !== 0) !== inHandler && chip.clock.nanos < patience) step();
    if ((chip.core.IPSR !== 0) !== inHandler) say(`complaint no ${inHandler ? "interrupt came" : "handler ended"}`);
    chip.sram.set([0xfe, 0xe7], 0x41000); // b .
    chip.core.PC = 0x20041000;
}

addFlash(chip, FLASH_ID, (text) => say(`complaint ${text}`));
const host = new UsbHost(chip, say);
start();
watchData();
for (;;) {
    // `run SECONDS`, `line PIN LEVEL`, `hang program` or `handler`, `feed BYTE…` or `usb ORDER …`
    const [verb, ...words] = ask(`ready ${seconds()} ${[...warnings].join("; ")}`).split(" ");
    if (verb === "line") {
        chip.gpio[Number(words[0])].setInputValue(words[1] === "1");
    } else if (verb === "hang") {
        hang(words[0] === "handler");
    } else if (verb === "usb") {
        const [order, ...numbers] = [words[0], ...words.slice(1).map(Number)];
        if (order === "plug") host.plug();
        else if (order === "unplug") host.unplug();
        else if (order === "open") host.order(host.opened(numbers[0] === 1));
        else if (order === "read") host.reads = numbers[0] === 1;
        else host.order(host.send(numbers));
    } else if (verb === "feed") {
        words.forEach((byte, place) => after(place * 21700, () => chip.uart[0].feedByte(Number(byte))));
    } else {
        const until = Number(words[0]) * 1e9;
        while (chip.clock.nanos < until) step();
    }
}
