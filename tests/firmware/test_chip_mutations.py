# ruff: noqa: E501  a mutation is easier to read in one line
"""Wrong drivers of the firmware's chips, each with one mistake: the C tests of that chip must catch all.

A mutation replaces a piece of the driver's file, or is a whole file of wrong_drivers/. The emulated chips share no code
with the drivers, but they share facts that both took from the same source.
"""

from __future__ import annotations

import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

pytestmark = pytest.mark.mutation

ROOT = Path(__file__).parents[2]
CHIPS = ROOT / "firmware/core/chips"
VECTORS = ROOT / "tests/data/wire_vectors.ini"
WRONG_DRIVERS = ROOT / "tests/firmware/wrong_drivers"
FLAGS = ["-std=c11", "-O1", "-I", CHIPS, "-I", CHIPS.parent]

# Which chips' tests judge a file that several chips share.
JUDGES = dict.fromkeys(("memsic", "sensor_film", "sensor_poll"), "mmc5") | {"sensor": "m", "sensor_turn": "qmc5883l_"}

# (file, the mistake, the correct text, the wrong one)
MUTATIONS = [
    ("memsic", "low byte first", "data[2 * axis] << 8 | data[2 * axis + 1]", "data[2 * axis + 1] << 8 | data[2 * axis]"),
    ("memsic", "signed, though zero is in the middle", "ZERO = 0x8000", "ZERO = 0"),
    ("memsic", "axes one register later", "AXES = 0x00", "AXES = 0x02"),
    ("memsic", "no SET when it is set up", "control_0, MEMSIC_SET, BANDWIDTH_2_MS}", "control_0, 0, BANDWIDTH_2_MS}"),
    ("memsic", "RESET when it is set up", "control_0, MEMSIC_SET, BANDWIDTH_2_MS}", "control_0, 0x10, BANDWIDTH_2_MS}"),
    ("memsic", "no SET after a strong field", "{wires->memsic->control_0, MEMSIC_SET};", "{wires->memsic->control_0, 0};"),
    ("memsic", "measurements of 0.5 to 1.2 ms, which are noisier", "BANDWIDTH_2_MS = 0x02", "BANDWIDTH_2_MS = 0x03"),
    ("memsic", "measurements of 3.5 to 4 ms", "BANDWIDTH_2_MS = 0x02", "BANDWIDTH_2_MS = 0x01"),
    ("memsic", "the bandwidth stays as after a reset", "BANDWIDTH_2_MS = 0x02", "BANDWIDTH_2_MS = 0x00"),
    ("memsic", "takes samples that are not done", "status & wires->memsic->field_done ? CHIP_READY : 0", "CHIP_READY"),
    ("memsic", "never looks whether it was reset", "*held = status & STATUS_FUSES_READ", "*held = true"),
    ("memsic", "does not reset", "(uint8_t)(wires->memsic->control_0 + 1), RESET}", "(uint8_t)(wires->memsic->control_0 + 1), 0}"),
    ("sensor", "does not wait after a SET", "now_us + CHIP_SET_PAUSE_US + sensor_chip", "now_us + sensor_chip"),
    ("sensor", "the time of a sample is the end of its measurement", "sensor->conversion.ended_us - measurement_us / 2", "sensor->conversion.ended_us"),
    ("sensor_poll", "does not set a chip up again that is not done", "} else if (sensor_chip(sensor)->set) {", "} else if (false) {"),
    ("sensor_poll", "the time of a sample is that of its reading", "sensor->conversion.ended_us = sensor->triggered_us + chip->trigger->conversion_us;", "sensor->conversion.ended_us = seen_us;"),
    ("sensor_poll", "measures in the pause after a SET", "sensor->due_us = sensor->settled_us - sensor_chip(sensor)->trigger->conversion_us;", "sensor->due_us = now_us;"),
    ("sensor_film", "no SET now and then", "SET_INTERVAL_US = 600000000", "SET_INTERVAL_US = 4000000000"),
    ("sensor_film", "a SET every second", "SET_INTERVAL_US = 600000000", "SET_INTERVAL_US = 1000000"),
    ("sensor_film", "no SET after a strong field", "return has_gone || ", "return "),
    ("sensor_film", "a SET while the field is still strong", "bool has_gone = met == FILM_UNDISTURBED && ", "bool has_gone = "),
    ("sensor_film", "samples of an upset film count", "axis < 3 && (sensor->film == FILM_UPSET || has_gone); axis++", "axis < 0; axis++"),
    ("sensor_film", "a strong field counts only where an axis is at its end", "return square > (uint32_t)limit * limit;", "return false;"),
    ("sensor_film", "a doubtful field is forgotten", "is_beyond(counts, chip->doubtful_counts) ? FILM_DOUBTFUL", "false ? FILM_DOUBTFUL"),
    ("mmc5983ma", "the old driver as a whole: automatic set and a stream", None, "mmc5983ma_with_automatic_set.c"),
    ("mmc5983ma", "command 0x21", ".bytes = {CONTROL_0, MEMSIC_MEASURE_FIELD}", ".bytes = {CONTROL_0, MEMSIC_MEASURE_FIELD | 0x20}"),
    ("mmc5983ma", "triggers the thermometer", ".bytes = {CONTROL_0, MEMSIC_MEASURE_FIELD}", ".bytes = {CONTROL_0, 0x02}"),
    ("mmc5983ma", "reads before a measurement is done", ".wait_us = 2200", ".wait_us = 1000"),
    ("mmc5983ma", "another time of a measurement", ".conversion_us = 2000", ".conversion_us = 2600"),
    ("mmc5983ma", "does not wait for its reset", "RESET_US = 10000", "RESET_US = 100"),
    ("mmc5983ma", "waits for the thermometer", "STATUS_FIELD_DONE = 0x01", "STATUS_FIELD_DONE = 0x02"),
    ("mmc5983ma", "the last counts count as a field", "LARGEST = 32766", "LARGEST = 32767"),
    ("mmc5983ma", "what upsets the film counts", "STRONG = 9 * 4096", "STRONG = 15 * 4096"),
    ("mmc5983ma", "another chip's name", "PRODUCT_ID = 0x30", "PRODUCT_ID = 0x31"),
    ("mmc5983ma", "a stream of its own", ".paced = true", ".paced = false"),
    ("mmc5603nj", "the MMC5983MA's controls", "CONTROL_0 = 0x1B", "CONTROL_0 = 0x09"),
    ("mmc5603nj", "the MMC5983MA's status", "STATUS = 0x18", "STATUS = 0x08"),
    ("mmc5603nj", "automatic set/reset", ".bytes = {CONTROL_0, MEMSIC_MEASURE_FIELD}", ".bytes = {CONTROL_0, MEMSIC_MEASURE_FIELD | 0x20}"),
    ("mmc5603nj", "waits for the thermometer", "STATUS_FIELD_DONE = 0x40", "STATUS_FIELD_DONE = 0x80"),
    ("mmc5603nj", "the MMC5983MA's name", "PRODUCT = 0x39", "PRODUCT = 0x2F"),
    ("mmc5603nj", "does not wait for its reset", "RESET_US = 20000", "RESET_US = 10000"),
    ("mmc5603nj", "the MMC5983MA's film", "STRONG = 30 * 1024", "STRONG = 9 * 1024"),
    ("qmc5883p", "signs are not defined", "{SIGNS, SIGNS_OF_AXES}", "{SIGNS, 0}"),
    ("qmc5883p", "high byte first", "data[2 * axis] | data[2 * axis + 1] << 8", "data[2 * axis + 1] | data[2 * axis] << 8"),
    ("qmc5883p", "axes one register earlier, as the QMC5883L's", "DATA = 0x01", "DATA = 0x00"),
    ("qmc5883p", "the status's register is wrong", "STATUS = 0x09", "STATUS = 0x06"),
    ("qmc5883p", "ranges in the other order", "GAIN_CODES - 1 - setup->gain_code", "setup->gain_code"),
    ("qmc5883p", "range bits shifted wrongly, as in two flight controllers", "RANGE_SHIFT = 2", "RANGE_SHIFT = 4"),
    ("qmc5883p", "stays suspended", "NORMAL_200_HZ = 0x0D", "NORMAL_200_HZ = 0x0C"),
    ("qmc5883p", "100 Hz in place of 200", "NORMAL_200_HZ = 0x0D", "NORMAL_200_HZ = 0x09"),
    ("qmc5883p", "set and reset off", "<< RANGE_SHIFT);", "<< RANGE_SHIFT | 2);"),
    ("qmc5883p", "oversampled less, which is noisier", "NORMAL_200_HZ = 0x0D", "NORMAL_200_HZ = 0x3D"),
    ("qmc5883p", "takes samples that are not ready", "byte & STATUS_READY ? CHIP_READY : 0", "CHIP_READY"),
    ("qmc5883p", "waits for an overflow", "STATUS_READY = 0x01", "STATUS_READY = 0x02"),
    ("qmc5883p", "the last count counts as a field", "LARGEST = 30000", "LARGEST = 32767"),
    ("qmc5883p", "a potentiometer will do", "identification[2] &= SOFT_RESET", "identification[2] = 0"),
    ("qmc5883p", "any name will do", "identification[0] == PRODUCT_ID &&", "identification[0] != 1 &&"),
    ("qmc5883p", "does not see that it was reset", "bytes[0] == NORMAL_200_HZ && ", ""),
    ("qmc5883p", "does not look at its range", " && bytes[1] == control_2(setup)", ""),
    ("qmc5883p", "a period that is not its rate's", "{{200, 5000}}", "{{200, 6000}}"),
    ("mlx90393", "RES 0, which wraps around", "RESOLUTIONS = 2 << 9 | 2 << 7 | 2 << 5", "RESOLUTIONS = 0"),
    ("mlx90393", "RES 2 for x and y alone", "RESOLUTIONS = 2 << 9 | 2 << 7", "RESOLUTIONS = 0 << 9 | 2 << 7"),
    ("mlx90393", "signed, though zero is in the middle", "ZERO = 0x8000", "ZERO = 0"),
    ("mlx90393", "zero of RES 3", "ZERO = 0x8000", "ZERO = 0x4000"),
    ("mlx90393", "temperature read as x", "answer[3 + 2 * axis] << 8 | answer[4 + 2 * axis]", "answer[1 + 2 * axis] << 8 | answer[2 + 2 * axis]"),
    ("mlx90393", "low byte first", "answer[3 + 2 * axis] << 8 | answer[4 + 2 * axis]", "answer[4 + 2 * axis] << 8 | answer[3 + 2 * axis]"),
    ("mlx90393", "temperature's low byte first", "answer[1] << 8 | answer[2]); // 46244", "answer[2] << 8 | answer[1]); // 46244"),
    ("mlx90393", "gains in the other order", "FINEST_GAIN_SEL - setup->gain_code", "setup->gain_code"),
    ("mlx90393", "gain shifted wrongly", "setup->gain_code) << 4", "setup->gain_code) << 3"),
    ("mlx90393", "filters that never end (table 18)", "filters[] = {7, 6, 5, 4}", "filters[] = {0, 1, 0, 1}"),
    ("mlx90393", "filters in the other order", "filters[] = {7, 6, 5, 4}", "filters[] = {4, 5, 6, 7}"),
    ("mlx90393", "a single filter that never ends", "SINGLE_FILTER = 3", "SINGLE_FILTER = 1"),
    ("mlx90393", "overwrites what the factory wrote", "(analog & ~ANALOG)", "(analog & 0)"),
    ("mlx90393", "register's number is not shifted", "(uint8_t)value, (uint8_t)(number << 2)", "(uint8_t)value, number"),
    ("mlx90393", "does not leave the burst", "chip_read(wires, EXIT, &status, 1)", "chip_read(wires, NOTHING, &status, 1)"),
    ("mlx90393", "does not wait until the measurement has ended", "EXIT_US = 1000", "EXIT_US = 10"),
    ("mlx90393", "an error counts as a sample", "result != BUS_OK || (answer[0] & STATUS_ERROR)", "result != BUS_OK"),
    ("mlx90393", "pauses 20 ms between measurements", "BURST_OF_ALL = ALL << 6", "BURST_OF_ALL = ALL << 6 | 1"),
    ("mlx90393", "does not see that a reset ended the burst", "(status & (STATUS_BURST | STATUS_ERROR)) == STATUS_BURST", "true"),
    ("mlx90393", "beyond the converter's end it counts on", "LARGEST = 21999", "LARGEST = 30000"),
    ("mlx90393", "measures no temperature", "ALL = 0x0F", "ALL = 0x0E"),
    ("mlx90393", "streams although it waits for triggers", "setup->streams ? BURST : SINGLE", "BURST"),
    ("mlx90393", "does not read the first measurement's status", "(setup->streams ? BURST : SINGLE) | ALL", "(setup->streams ? BURST | ALL : NOTHING)"),
    ("mlx90393", "waits as long as the table says", ".wait_us = 3730", ".wait_us = 2900"),
    ("sensor_turn", "asks by writing where another kind was misread", "if (answered && sensor_chip(sensor)->asked_by_writing && !sensor->doubts)", "if (false)"),
    ("sensor", "the time of an MLX90393's sample is the end of its measurement", "chip->fills_period ? sensor->conversion.period_us : 0", "0"),
    ("mlx90393", "triggers a burst", ".bytes = {SINGLE | ALL}", ".bytes = {BURST | ALL}"),
    ("mlx90393", "reads registers of a single measurement that runs", "status & STATUS_SINGLE;", "false;"),
    ("mlx90393", "any answer will do", "(identification[2] & HALL_BITS) == HALL_CONFIGURATION", "true"),
    ("mlx90393", "a refusal will do", "(identification[0] & STATUS_MODE_OR_ERROR) == 0", "true"),
    ("mlx90393", "a period that is not its rate's", "{133, 7478}", "{133, 9000}"),
    ("lis3mdl", "high byte first", "data[2 * axis] | data[2 * axis + 1] << 8", "data[2 * axis + 1] | data[2 * axis] << 8"),
    ("lis3mdl", "no advance: one register six times", "ADVANCE = 0x80", "ADVANCE = 0x00"),
    ("lis3mdl", "axes one register later", "AXES = 0x28", "AXES = 0x2A"),
    ("lis3mdl", "range bits shifted wrongly", "setup->gain_code << 5", "setup->gain_code << 4"),
    ("lis3mdl", "z has another performance", "performances[speed] << 2", "performances[speed]"),
    ("lis3mdl", "noisier than the rate asks for", "performances[] = {ULTRA_HIGH, ULTRA_HIGH, HIGH}", "performances[] = {HIGH, HIGH, HIGH}"),
    ("lis3mdl", "stays off", "setup->streams ? MODE_CONTINUOUS : MODE_OFF", "MODE_OFF"),
    ("lis3mdl", "streams although it waits for triggers", "setup->streams ? MODE_CONTINUOUS : MODE_OFF", "MODE_CONTINUOUS"),
    ("lis3mdl", "10 Hz in place of 80", "RATE_80_HZ = 7 << 2", "RATE_80_HZ = 4 << 2"),
    ("lis3mdl", "not fast", "FAST = 0x02", "FAST = 0x10"),
    ("lis3mdl", "thermometer off", "THERMOMETER_ON = 0x80", "THERMOMETER_ON = 0x00"),
    ("lis3mdl", "temperature high byte first", "data[0] | data[1] << 8", "data[1] | data[0] << 8"),
    ("lis3mdl", "temperature read on from the axes", "ADVANCE | TEMPERATURE", "ADVANCE | 0x2C"),
    ("lis3mdl", "high and low bytes need not belong together", "BLOCK_UPDATE = 0x40", "BLOCK_UPDATE = 0x00"),
    ("lis3mdl", "takes samples that are not ready", "status & STATUS_READY ? CHIP_READY : 0", "CHIP_READY"),
    ("lis3mdl", "waits for an overrun", "STATUS_READY = 0x08", "STATUS_READY = 0x80"),
    ("lis3mdl", "beyond its full scale it counts on", "LARGEST = 27366", "LARGEST = 40000"),
    ("lis3mdl", "marks what it can tell", "LARGEST = 27366", "LARGEST = 20000"),
    ("lis3mdl", "another chip's name", "IDENTIFICATION = 0x3D", "IDENTIFICATION = 0x3E"),
    ("lis3mdl", "never looks whether its settings are kept", "for (int i = 0; i < CONTROLS && *held; i++)", "for (int i = 0; i < 0; i++)"),
    ("lis3mdl", "takes a running measurement for lost settings", "|| (i == MODE_CONTROL && !setup->streams)", ""),
    ("lis3mdl", "does not see that its stream has ended", "(i == MODE_CONTROL && !setup->streams)", "i == MODE_CONTROL"),
    ("lis3mdl", "triggers a stream", ".bytes = {CONTROL_3, MODE_SINGLE}", ".bytes = {CONTROL_3, MODE_CONTINUOUS}"),
    ("lis3mdl", "a period that is not its rate's", "{155, 6452}", "{155, 7500}"),
    ("qmc5883l", "asks for its name before anything else", "chip_read(wires, DATA, bytes, 1);", "BUS_OK;"),
    ("qmc5883l", "high byte first", "data[2 * axis] | data[2 * axis + 1] << 8", "data[2 * axis + 1] | data[2 * axis] << 8"),
    ("qmc5883l", "range bits shifted wrongly", "setup->gain_code << 4", "setup->gain_code << 5"),
    ("qmc5883l", "100 Hz in place of 200", "CONTINUOUS_200_HZ = 0x0D", "CONTINUOUS_200_HZ = 0x09"),
    ("qmc5883l", "no continuous mode", "CONTINUOUS_200_HZ = 0x0D", "CONTINUOUS_200_HZ = 0x0C"),
    ("qmc5883l", "takes samples that are not ready", "byte & STATUS_READY ? CHIP_READY : 0", "CHIP_READY"),
    ("qmc5883l", "the last count counts as a field", "LARGEST = 32766", "LARGEST = 32767"),
    ("qmc5883l", "does not look at the overflow flag", "untold = data[STATUS] & STATUS_OVERFLOW", "untold = false"),
    ("qmc5883l", "takes a skipped sample for an overflow", "STATUS_OVERFLOW = 0x02", "STATUS_OVERFLOW = 0x04"),
    ("qmc5883l", "marks all axes where one tells that it is the one", "untold && counts[axis] != CHIP_SATURATED", "untold"),
    ("qmc5883l", "the status's register is wrong", "STATUS = 0x06", "STATUS = 0x05"),
    ("qmc5883l", "any identification will do", "identification[2] == 0xFF &&", "identification[2] != 1 ||"),
    ("qmc5883l", "a period that is not its rate's", "{{200, 5000}}", "{{200, 6000}}"),
]  # fmt: skip


def compiled(source: Path, folder: Path) -> Path:
    made = folder / f"{source.stem}.o"
    subprocess.run(["gcc", *FLAGS, "-c", source, "-o", made], check=True, timeout=120)
    return made


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Files of the core, the emulation and the C tests, by folder and name."""
    folder = tmp_path_factory.mktemp("objects")
    firmware = ROOT / "firmware"
    sources = [firmware / "host/emulation.c"]
    for each in (firmware / "core", CHIPS, firmware / "emulated", ROOT / "tests/firmware"):
        sources += sorted(each.glob("*.c"))

    def made(source: Path) -> tuple[str, Path]:
        place = folder / source.parent.name
        place.mkdir(exist_ok=True)
        return f"{source.parent.name}/{source.stem}", compiled(source, place)

    with ThreadPoolExecutor(2) as pool:
        return dict(pool.map(made, sources))


def source_of(kind: str) -> Path:
    return next(path for path in (CHIPS / f"{kind}.c", CHIPS.parent / f"{kind}.c") if path.exists())


def failures(objects: dict[str, Path], driver: Path, kind: str, folder: Path) -> list[str]:
    """The result of the tests of `kind` for this driver."""
    changed = objects | {f"{source_of(kind).parent.name}/{kind}": compiled(driver, folder)}
    program = folder / "test-core"
    subprocess.run(["gcc", *changed.values(), "-o", program, "-lm"], check=True, timeout=120)
    run = subprocess.run([program, VECTORS, JUDGES.get(kind, f"{kind}_")], capture_output=True, text=True, timeout=120)
    assert run.stdout.count("ok ") + run.stdout.count("FAIL ") > 10, "the tests were not found"
    return [line for line in run.stdout.splitlines() if line.startswith("FAIL")]


@pytest.mark.parametrize("kind", sorted({kind for kind, *_ in MUTATIONS}))
def test_right_driver_of_the_firmware_passes(objects: dict[str, Path], tmp_path: Path, kind: str) -> None:
    assert failures(objects, source_of(kind), kind, tmp_path) == []


@pytest.mark.parametrize(("kind", "what", "right", "wrong"), MUTATIONS, ids=[f"{m[0]}: {m[1]}" for m in MUTATIONS])
def test_wrong_driver_of_the_firmware_is_caught(
    objects: dict[str, Path], tmp_path: Path, kind: str, what: str, right: str | None, wrong: str
) -> None:
    source = source_of(kind).read_text()
    assert right is None or right in source, f"the mutation of {kind} mutates nothing: {right}"
    mutated = tmp_path / f"{kind}.c"
    mutated.write_text(source.replace(right, wrong) if right else (WRONG_DRIVERS / wrong).read_text())
    assert failures(objects, mutated, kind, tmp_path), f"nothing notices a {kind} driver with this mistake: {what}"
