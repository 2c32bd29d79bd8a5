// The flash's own commands, behind the RP2040's SSI, which rp2040js lacks: only the one that reads its number.
"use strict";

const READ_UNIQUE_ID = 0x4b; // W25Q16JV data sheet 8.2.37
const BEFORE_ID = 5;
const SSI = 0x18000;
const IO_QSPI = 0x40018;
const [SSIENR, SR, DR0, SS_CTRL] = [0x08, 0x28, 0x60, 0x0c];
const [IDLE, HAS_RECEIVED] = [0x06, 0x08];
const ROOM = 16;

function addFlash(chip, id, complain) {
    const [ssi, pins] = [chip.peripherals[SSI], chip.peripherals[IO_QSPI]];
    const [readSsi, writeSsi, writePins] = [ssi.readUint32.bind(ssi), ssi.writeUint32.bind(ssi), pins.writeUint32.bind(pins)];
    let enabled = true;
    let selected = false;
    let sent = [];
    let received = [];
    const fromFlash = () => chip.core.PC >>> 28 === 1;
    ssi.writeUint32 = (offset, value) => {
        if (offset === SSIENR) enabled = value === 1;
        if (offset !== DR0) {
            writeSsi(offset, value);
            return;
        }
        if (fromFlash()) complain("a program that runs from the flash cannot speak to it");
        if (!enabled) complain("the SSI is off");
        if (received.length === ROOM) complain("the SSI has no room left");
        const at = sent.push(value & 0xff) - 1;
        received.push(selected && sent[0] === READ_UNIQUE_ID && at >= BEFORE_ID ? id[at - BEFORE_ID] : 0xff);
    };
    ssi.readUint32 = (offset) => {
        if (offset === SR) return IDLE | (received.length > 0 ? HAS_RECEIVED : 0);
        return offset === DR0 ? received.shift() : readSsi(offset);
    };
    pins.writeUint32 = (offset, value) => {
        if (offset === SS_CTRL) {
            selected = ((value >> 8) & 3) === 2;
            sent = [];
        }
        writePins(offset, value);
    };
}

module.exports = { addFlash };
