# make help    print these lines
# make demo    install into .venv, run the simulated pad, show its contacts    (SECONDS=10 ends by itself; PAD=array
#              FINGERS=2: four magnets, two fingers that meet and part; PAPER=1: the
#              paper's forty readings through the firmware's own code; FIRMWARE=1: a finger on an emulated STM32 board;
#              HAND=1: five boards on a page in a browser, beside what a fixed baseline and a hand that was never turned say;
#              RUNS=20: twenty whole cycles of it, each of another world, judged together: half an hour)
# make first-minute   how soon `make demo` shows the first `ok`, its deviations at 1 N, lost frames    (DEMO="PAD=array")
# make chips-for-a-day   every driver on its emulated chips for a day of their time: 6 to 15 minutes for each chip
# make start-time        how long the daemon takes to be ready; PYTHONS="A B": those of two versions, in turns
# make sample-times      when samples were measured, and whether any comes twice: eight minutes
# make magnet-check   what `probe --magnet` says of 200 random mistakes and 50 good boards: five minutes    (MAGNET_CHECK="--seed 2")
# make mould   the mould of a pad of other sizes for a printer, as STL: needs OpenSCAD (hardware/ has the standard pad's)
# make fingertip   the fingertip for LEAP and Allegro hands, as STL in build/: needs OpenSCAD (hardware/ has them, too)
# make first-uses   from `init` to contacts with each chip that Linux reads, on two I2C adapters: figures, three minutes
# make chips-page   write the tables of docs/chips.md and lab/results/chip-facts.md anew from the chips' descriptions
# make transcript   type the first use of README on the firmware's host build, and write what is said into docs/first-use.md
# make security     ten attacks by another user of this computer, and a table of what they gained (root; two minutes)
# make page-drills  the page under load: many pads, pages and strangers, an hour's run, the first use of a board
# make docs    the manual, the results and a reference from docstrings as a site in build/site, to read and search without a
#              network; fails if a link leads nowhere or a docstring is missing (a minute)
# make words   the words of README and the manual, and of the laboratory's results; the aim for the manual is 40,000
# make docs-test    type every command of the pages that needs neither hardware nor root, as it stands there (ten minutes)
# make pictures     take the pictures of the manual from the real page, in Chromium
# make test    set up what the tests need, run all parts, and summarise    (PARTS="lint unit": only those; or make lint …)
# make test-fresh    the same in a fresh clone on a plain Debian 12, as root; and the demo as an ordinary user
# make test-systems    the Debian package, and pip, on Debian 12 and 13, Ubuntu 22.04 and 24.04, as root    (SYSTEMS=ubuntu-22.04)
# make test-busy    the demo and all tests five times in fresh clones, beside two busy processes: two hours    (TURNS=5)
# make long    tests that take more than ten seconds: the laboratory's studies, long runs of pads (six minutes)
# make mutations    wrong drivers and wrong emulators, each of which a test must catch (two minutes)
# make slow    the page in Chromium, the fault drills, a whole installation, a drift that is followed (six minutes)
# make test-firmware-long    half a minute of the emulated board's time
# make test-rp2040    the firmware for a Raspberry Pi Pico on rp2040js
# make install, uninstall    install into PREFIX=/usr/local; make deb: make a Debian package in build/
# make install-c-client      install the client for controllers in C and C++ into PREFIX
# make drills, soak, chaos, drill-service, aarch64    all fault drills; random faults on many pads; pairs of faults, each
#              number judged by its frame; the service under systemd on a plain Debian; tests on aarch64
# make failing-source    a source that raises or returns anything, beside three healthy pads: five minutes
# make clock-leaps    boards whose clock leaps, lines that double and reorder packets: four minutes
# make flood   contacts and their ages while 1 to 64 programs flood the control socket, six minutes    (FLOOD="--pads 8 --over ipc")
# make sanitize    the compiled parts and the C client under AddressSanitizer and UndefinedBehaviorSanitizer; long
#              (SHORT=1: a minute)
# make fuzz    a million inputs to each decoder, or FUZZ_SECONDS=300 of each: 50 minutes; make fuzz-short: some minutes
# make fuzz-files    a million damaged files
# make golden  every frame of the frozen worlds against what was said of it: a minute; make golden-freeze: keep what is
#              said now, and say in the commit why    (GOLDEN="--way recorded healthy"); make net-catches: 106 deliberate
#              changes of equations, gates and memories, each of which the oracle or a frozen world must find
# make test-versions         each installed Python with the oldest, newest and pinned dependencies: half an hour
# make wheel   a wheel for this architecture; fails if a compiled part is missing
# make dist    wheels for x86-64 and aarch64, and source archives, in dist/, as a package index takes them (root: aarch64);
#              their SBOM, SHA256SUMS and a signature where a key is configured    (DEB=1: the Debian package, too; SIGN=1)
# make constraints    the newest versions of all dependencies with their hashes, in release/constraints*.txt
# make reproducible    two builds of HEAD must give the same wheels and the same Debian package    (QUICK=1: not for aarch64, nothing compressed)
# make test-dist   what is in dist/ in clean environments of each Python: the demo from there; SIZES=1: how large each extra is
# make release     check HEAD, then `dist`, `test-dist` and a tag, signed where a key is configured; CHECK=1: no tag. Uploads nothing
# make lerobot the LeRobot package with the real LeRobot (6 GB the first time)
# make mujoco  the MuJoCo package: its tests, what a pad costs a step, its policy here and over the bus (160 MB; ten minutes)
# make grip    the example that grips with the least force: 200 lifts in MuJoCo, and of force alone (half an hour)
#              (GRIP="--lifts 40 --seed 7 --as-built"; python -m fmfts_mujoco.grip --help)
# make viewers  what Rerun, Foxglove and MCAP's own decoder read of a recording (300 MB the first time; npm)
# make ros     the ROS 2 package with real rclpy of two distributions (600 MB the first time)
# make sizes   modules longer than 250 lines, and the lines of each room
# make bench   time and accuracy of a solve, and latency of a frame; make cold-starts: convergence, half an hour

PYTHON ?= python3
# Packages of their own, which the robot's package names as extras.
EXTRAS := $(sort $(patsubst %/pyproject.toml,%,$(wildcard extras/*/pyproject.toml)))
VENV := .venv
BIN := $(VENV)/bin
SECONDS ?=
PAPER ?=
FIRMWARE ?=
HAND ?=
RUNS ?=

# Packages that a bare Debian lacks: python3-venv, and python3-dev with Python.h for the compiled parts.
BASE_PACKAGES := $(shell $(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || echo python3-venv) \
	$(shell $(PYTHON) -c 'import os, sysconfig, sys; sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' 2>/dev/null || echo python3-dev)
missing_packages = $(foreach package,$(1),$(shell dpkg-query -W -f '$${Status}' $(package) 2>/dev/null | grep -q 'ok installed' || echo $(package)))
# Packages for tests. umockdev emulates the kernel's I2C interface, and needs the system's own Python (python3-gi).
TEST_PACKAGES := $(call missing_packages,umockdev gir1.2-umockdev-1.0 python3-gi faketime g++ openscad gcc-arm-none-eabi clang libclang-rt-dev lld libnewlib-arm-none-eabi gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user systemd libzmq3-dev cmake pkg-config chromium openssh-client)

.PHONY: help demo test lint unit processes clock slow long mutations bench cold-starts clean wheel
.PHONY: first-uses transcript recordings kept-report model pictures chips-page mould fingertip sample-times
.PHONY: first-minute start-time magnet-check chaos clock-leaps failing-source chips-for-a-day fuzz fuzz-short fuzz-files page-drills collect-chain collect-drills test-versions test-firmware-long
.PHONY: firmware firmware-for-tests base-packages test-packages

# Ends a demo on Ctrl-C without an error. Programs that sh starts with & ignore Ctrl-C; sh catches it and sends SIGTERM
# instead, because Python would print a traceback if Ctrl-C came while it starts.
until_interrupted = trap 'kill $$demo; wait $$demo 2>/dev/null; exit 0' INT TERM HUP; $(1) & demo=$$!; wait $$demo

demo: $(VENV)/.installed $(if $(PAPER)$(HAND),firmware) $(if $(FIRMWARE),test-packages $(VENV)/.installed-test)
ifneq ($(PAPER),)
	@$(call until_interrupted,$(BIN)/python tests/end_to_end/paper_demo.py)
else ifneq ($(FIRMWARE),)
	@$(call until_interrupted,$(BIN)/python tests/end_to_end/firmware_demo.py $(if $(SECONDS),--seconds $(SECONDS)))
else ifneq ($(HAND),)
	@$(call until_interrupted,$(BIN)/python tests/end_to_end/hand_demo.py $(if $(SECONDS),--seconds $(SECONDS)) $(if $(RUNS),--runs $(RUNS)))
else
	@$(call until_interrupted,$(BIN)/python -m fmfts_simulation.demo $(if $(SECONDS),--seconds $(SECONDS)) $(if $(PAD),--pad $(PAD)) $(if $(FINGERS),--fingers $(FINGERS)))
endif

help:
	@sed -n '/^#/!q; s/^# \{0,1\}//p' $(firstword $(MAKEFILE_LIST))

first-minute: $(VENV)/.installed
	$(BIN)/python tests/drills/first_minute.py $(DEMO)

magnet-check: $(VENV)/.installed-test
	$(BIN)/python tests/drills/magnet_check.py $(MAGNET_CHECK)

chips-for-a-day: $(VENV)/.installed-test
	$(BIN)/python tests/drills/chips_for_a_day.py $(CHIPS_FOR_A_DAY)

# The mould of docs/build-a-pad.md for a printer: build/mould-tray.stl and -lid.stl. hardware/ holds those of
# the standard pad; after a change of the source copy them there. Another pad: MOULD="-D pad_size=[30,30,4]".
MOULD ?=
mould:
	@$(call need,$(call missing_packages,openscad),exit 1)
	@mkdir -p build
	openscad -q -o build/mould-tray.stl -D 'part="tray"' $(MOULD) hardware/mould.scad
	openscad -q -o build/mould-lid.stl -D 'part="lid"' $(MOULD) hardware/mould.scad

# build/fingertip-*.stl, as hardware/ has them. Another board or cable: FINGERTIP="-D boards=[40,40]". After a change of the
# source copy them there.
FINGERTIP ?=
fingertip:
	@$(call need,$(call missing_packages,openscad),exit 1)
	@mkdir -p build
	openscad -q --export-format binstl -o build/fingertip-leap.stl -D 'hand="leap"' $(FINGERTIP) hardware/fingertip.scad
	openscad -q --export-format binstl -o build/fingertip-allegro.stl -D 'hand="allegro"' $(FINGERTIP) hardware/fingertip.scad
	openscad -q --export-format binstl -o build/fingertip-lid.stl -D 'part="lid"' $(FINGERTIP) hardware/fingertip.scad

start-time: $(VENV)/.installed
	$(BIN)/python tests/drills/start.py $(PYTHONS)

first-uses: test-packages $(VENV)/.installed-test
	$(BIN)/python tests/end_to_end/i2c_first_use.py $(FIRST_USES)
# How right the times of samples are of chips that the reader starts one by one: four times a hundred thousand frames.
SAMPLE_FRAMES ?= 100000
sample-times: $(VENV)/.installed-test
	PYTHONPATH=tests:tests/unit $(BIN)/python tests/unit/sample_times.py $(SAMPLE_FRAMES)

chips-page: $(VENV)/.installed-test
	$(BIN)/python -m fmfts_lab.study.chips_page

transcript: $(VENV)/.installed-test firmware
	$(BIN)/python tests/end_to_end/first_use.py

# What is missing, or leads nowhere, is a warning, which ends the build; `built_site.py` judges what was built.
SITE := build/site
.PHONY: docs docs-test words
words:
	@echo "README and docs: $$(cat README.md docs/*.md | wc -w) words, $$(cat README.md docs/*.md | tr -d '|' | wc -w) without the bars of tables"
	@echo "lab/README.md and lab/results: $$(cat lab/README.md lab/results/*.md | wc -w); README: $$(wc -l <README.md) lines; CHANGELOG: $$(wc -w <CHANGELOG.md)"
docs: $(VENV)/.installed-docs
	$(BIN)/python -m sphinx -q -E -W --keep-going -b html -c docs/site -d build/site-doctrees . $(SITE)
	$(BIN)/python tests/pages/built_site.py $(SITE)

docs-test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -q tests/pages

# What docs or versions of pyproject.toml name, without compiling fmfts again.
$(VENV)/.installed-docs $(VENV)/.installed-versions: $(VENV)/.installed-%: pyproject.toml $(VENV)/.installed
	@$(BIN)/python -c 'import importlib.metadata as meta; print(*(one.split(";")[0] for one in meta.requires("fmfts") if "\"$*\"" in one), sep="\n")' \
	    | $(BIN)/pip install --quiet --disable-pip-version-check -r /dev/stdin
	@touch $@

# Takes the pictures of docs/page.md again, from the real page.
pictures: test-packages $(VENV)/.installed-test firmware
	$(BIN)/python tests/page/pictures.py

# Many pads, pages and strangers, a guided first use, and an hour of the page (shorter: FMFTS_PAGE_SECONDS=60; it also
# shortens what is measured of five pages); nothing else may run meanwhile.
page-drills: test-packages $(VENV)/.installed-test firmware
	$(BIN)/python -m pytest -s tests/page/page_drills.py tests/page/drawing_drills.py

# What another user of this computer gains who attacks a daemon and its page; as root, who can become that user.
.PHONY: security
security: test-packages $(VENV)/.installed-test
	$(BIN)/python -m pytest -s -q tests/security

PARTS ?=
test: test-packages $(VENV)/.installed-test firmware-for-tests
	@$(BIN)/python tests/all_parts.py $(PARTS)

lint unit processes clock slow long mutations: $(VENV)/.installed-test
	@$(BIN)/python tests/all_parts.py $@

processes clock slow mutations: firmware-for-tests

# Builds the firmware before the tests, so that several tests do not build it at once; the tests report what failed.
firmware-for-tests: | test-packages
	-@$(MAKE) --no-print-directory -j2 -s -k -C firmware host stm32 stm32-clang rp2040 >/dev/null
	-@$(MAKE) --no-print-directory -s -C firmware rp2040 RP2040_BOARD=qtpy >/dev/null

test-firmware-long: test-packages $(VENV)/.installed-test
	FMFTS_EMULATED_SECONDS=30 $(BIN)/python -m pytest tests/firmware/test_emulator_stream.py --durations=5

# The RP2040's firmware on an emulator of the whole chip, and the daemon's verbs on it; node and npm must be there. RP2040JS=DIR: an rp2040js of yours.
.PHONY: test-rp2040
test-rp2040: test-packages $(VENV)/.installed-test
ifeq ($(RP2040JS),)
	@npm install --silent --no-save --no-audit --no-fund --prefix $(VENV) rp2040js@1.4.1
endif
	RP2040JS=$(RP2040JS) $(BIN)/python -m pytest -n 2 tests/firmware/rp2040_drills.py tests/firmware/rp2040_daemon_drills.py

# Shorter: VERSIONS="--python 3.12 --set oldest tests/unit/test_bus.py".
VERSIONS ?=
test-versions: test-packages $(VENV)/.installed-test
	@$(BIN)/pip install --quiet --disable-pip-version-check -e clients/python -e '.[versions]'
	$(BIN)/python tests/drills/versions.py $(VERSIONS)

sizes:
	@$(PYTHON) tests/module_sizes.py

bench: $(VENV)/.installed-test
	@mkdir -p build
	@$(BIN)/python -m fmfts_lab.bench speed
	@$(BIN)/python -m fmfts_lab.bench accuracy
	@$(BIN)/python -m fmfts_lab.bench latency --chart build/latency.svg

cold-starts: $(VENV)/.installed
	@$(BIN)/python -m fmfts_lab.bench convergence --draws 250000

# A million inputs to each decoder: the firmware's under libFuzzer (ten minutes), the daemon's and the C client's. For the
# daemon's C, requests and messages FUZZ_SECONDS each: about a million inputs in 300 s, of the tables 400,000.
fuzz: test-packages $(VENV)/.installed-test
	$(BIN)/python tests/firmware/fuzz/python_decoder.py --inputs 1000000
	$(BIN)/python tests/drills/anyskin_fuzz.py --inputs 1000000
	$(MAKE) -C firmware fuzz
	$(MAKE) fuzz-c-client fuzz-wire fuzz-clock fuzz-tables fuzz-frame fuzz-peers

# The same from the kept corpora on, a few seconds each.
fuzz-short: test-packages $(VENV)/.installed-test
	$(BIN)/python tests/firmware/fuzz/python_decoder.py --inputs 20000
	$(BIN)/python tests/drills/anyskin_fuzz.py --inputs 10000
	$(MAKE) -C firmware fuzz FUZZ_RUNS=3000
	$(MAKE) fuzz-c-client fuzz-wire fuzz-clock fuzz-tables fuzz-frame fuzz-peers FUZZ_SECONDS=5 C_CLIENT_FUZZ_RUNS=50000

# An access outside of an array, and an integer that overflows, end the process. build/sanitized holds what is built for it.
SHORT ?=
.PHONY: sanitize
sanitize: $(VENV)/.installed-test
	$(BIN)/python tests/sanitized/run.py $(if $(SHORT),--short)

# Everything that can go wrong, at random, in pairs, on 16 touched pads: ten million frames take 50 minutes.
CHAOS ?=
chaos: $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python -m drills.chaos.drill $(CHAOS)

# How contacts fare while programs flood the control socket; nothing else should run meanwhile.
FLOOD ?=
.PHONY: flood
flood: $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python tests/drills/flood.py $(FLOOD)

FAILING_SOURCE ?=
failing-source: $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python tests/drills/failing_source.py $(FAILING_SOURCE)

# A board's clock that leaps by 2^20 to 2^62 µs, and packets doubled, tripled and in another order: four minutes.
CLOCK_LEAPS ?=
clock-leaps: $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python -m drills.clock_leaps $(CLOCK_LEAPS)

# A million damaged files of all kinds that fmfts reads: two hours on two idle cores. FUZZ_INPUTS=20000: some minutes.
FUZZ_INPUTS ?= 1000000
fuzz-files: $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python tests/drills/file_fuzz.py --inputs $(FUZZ_INPUTS)

firmware:
	@$(MAKE) --no-print-directory -C firmware host

# baseline → collect → calibrate → evaluate on emulated machines: the paper's 675 presses, about twenty minutes.
collect-chain: $(VENV)/.installed-test firmware
	$(BIN)/python -u tests/end_to_end/collect_chain.py

# Measures how soon the rod is off the pad after each fault; nothing else may run meanwhile.
collect-drills: $(VENV)/.installed-test firmware
	$(BIN)/python -m pytest -s tests/end_to_end/collect_drills.py

# Makes the shipped contact models again, from the calibration set and from presses with shear.
SOLVED := $(addprefix extras/simulation/fmfts_simulation/,pressed.csv pressed_centre.csv sheared.csv)
model: $(VENV)/.installed-test
	mkdir -p build
	$(BIN)/python -m fmfts_lab.calibration.solved_set $(SOLVED) --mirrored --largest-force-n 2 -o build/sheared.csv
	$(BIN)/python -m fmfts_lab.calibration.shipped_models tests/data/calibration_1.23T.csv build/sheared.csv

# A wheel must have every compiled part, as pyproject.toml lists them.
COMPILED_PARTS = $(shell sed -n '/^name = "fmfts[.]/s|[.]|/|g; s|^name = "fmfts/\(.*\)"|\1|p' pyproject.toml)
.PHONY: compiled-parts
compiled-parts:
	@printf '%s\n' $(COMPILED_PARTS)

wheel: $(VENV)/.installed-test
	rm -rf build/wheel build/lib build/lib.* $(EXTRAS:%=%/build)  # nothing that an older build left
	$(BIN)/pip wheel -q --no-deps -w build/wheel . $(EXTRAS:%=./%)
	@for part in $(COMPILED_PARTS); do \
	  $(BIN)/python -m zipfile -l build/wheel/fmfts-*.whl | grep "fmfts/$$part.*so" >/dev/null || \
	    { echo "the wheel has no fmfts/$$part: is there a C compiler?" >&2; rm -rf build/wheel; exit 1; }; done
	@$(BIN)/python -m zipfile -l build/wheel/fmfts_page-*.whl | grep "fmfts_page/static/vendor/uPlot.esm.js" >/dev/null || \
	    { echo "the wheel has no page" >&2; exit 1; }
	@size=$$(cat build/wheel/fmfts-[0-9]*.whl | wc -c); test $$size -le 2500000 || \
	  { echo "the wheel has $$size bytes, and 2,500,000 are allowed: what came into it?" >&2; exit 1; }
	@ls build/wheel/*.whl

# What a package index takes: docs/installing.md.
SIZES ?=
CHECK ?=
.PHONY: dist test-dist release ros constraints
# DEB=1: with the Debian package. SIGN=1: signed with GnuPG's default key; else where `git config user.signingkey` is set.
DEB ?=
SIGN ?=
export SIGN
dist: test-packages $(VENV)/.installed-test $(if $(DEB),deb)
	@$(call need,$(call missing_packages,debootstrap python3-pip),exit 1)
	@$(BIN)/pip install --quiet --disable-pip-version-check -e clients/python -e '.[dist]'
	$(BIN)/python release/dist.py $(if $(DEB),--deb build/fmfts_$(VERSION)_$$(dpkg --print-architecture).deb)

test-dist: $(VENV)/.installed-test
	@$(BIN)/pip install --quiet --disable-pip-version-check -e clients/python -e '.[versions]'
	$(BIN)/python tests/drills/clean_environments.py $(if $(SIZES),--sizes)

constraints: $(VENV)/.installed-test
	@$(BIN)/pip install --quiet --disable-pip-version-check -e clients/python -e '.[versions]'
	$(BIN)/python release/constraints.py

release:
	$(BIN)/python release/release.py $(if $(CHECK),--check)

# Shorter: ROS="--distribution jazzy -k graph".
ROS ?=
ros: $(VENV)/.installed-test $(VENV)/.installed-versions firmware
	@$(call need,$(call missing_packages,g++ iproute2),exit 1)
	$(BIN)/python tests/ros/run.py $(ROS)

# LeRobot with torch (6 GB), on Python 3.12: a data set of a minute, read back.
.PHONY: lerobot
lerobot: $(VENV)/.installed-versions
	$(BIN)/python tests/drills/lerobot_drill.py

.PHONY: viewers
viewers: $(VENV)/.installed-versions
	@$(call need,$(if $(shell command -v npm),,npm),exit 1)
	$(BIN)/python tests/drills/viewers/drill.py

# Shorter: MUJOCO=tests alone, or MUJOCO="bench compare".
MUJOCO ?= tests bench compare
.PHONY: mujoco
mujoco: $(VENV)/.installed
	@$(BIN)/pip install --quiet --disable-pip-version-check -e './clients/mujoco[test]'
ifneq ($(filter tests,$(MUJOCO)),)
	cd clients/mujoco && $(abspath $(BIN))/python -m pytest -q
endif
ifneq ($(filter bench,$(MUJOCO)),)
	$(BIN)/python -m fmfts_mujoco.bench
endif
ifneq ($(filter compare,$(MUJOCO)),)
	$(BIN)/python -m fmfts_mujoco.compare
endif

GRIP ?= --lifts 200 --seed 1
.PHONY: grip
grip: $(VENV)/.installed
	@$(BIN)/pip install --quiet --disable-pip-version-check -e ./clients/mujoco
	$(BIN)/python -m fmfts_mujoco.grip $(GRIP)

# Makes the recordings that the tests replay again; the commit must explain why they change.
recordings: $(VENV)/.installed-test firmware
	$(BIN)/python tests/data/make_recordings.py
	$(BIN)/python tests/data/make_paper_recording.py

# All 269,909 frames of tests/golden; `make test` takes the first of each world.
GOLDEN ?=
.PHONY: golden golden-freeze net-catches
golden golden-freeze: $(VENV)/.installed-test
	PYTHONPATH=tests $(BIN)/python -m golden $(if $(filter golden-freeze,$@),--freeze) $(GOLDEN)

# NET="--only tracker": changes whose area or file has this.
NET ?=
net-catches: $(VENV)/.installed-test
	$(BIN)/python tests/drills/net_catches.py $(NET)

# Makes the report that tests/unit/test_kept_reports.py replays, and what that test demands of it.
kept-report: $(VENV)/.installed-test
	$(BIN)/python tests/data/make_report.py

$(VENV)/.installed: pyproject.toml $(wildcard daemon/fmfts/*/*.[ch] daemon/fmfts/*/*/*.[ch]) | base-packages
	@test -x $(BIN)/python || { echo "making $(VENV)"; $(PYTHON) -m venv $(VENV); }
	@echo "installing fmfts into $(VENV) (a minute the first time)"
	@$(BIN)/pip install --quiet --disable-pip-version-check -e clients/python -e . $(INSTALL_EXTRAS:%=-e ./%)
	@touch $@

$(VENV)/.installed-test: pyproject.toml $(EXTRAS:%=%/pyproject.toml) $(VENV)/.installed
	@echo "installing what the tests need into $(VENV)"
	@$(BIN)/pip install --quiet --disable-pip-version-check -e clients/python -e '.[test,fem]' -e ./lab $(EXTRAS:%=-e ./%)
	@touch $@

base-packages:
	@$(call need,$(BASE_PACKAGES),exit 1)

test-packages:
	@$(call need,$(TEST_PACKAGES),echo "without it the tests that need it are skipped" >&2)

# A new machine updates itself meanwhile, and a mirror may fail once.
APT := apt-get -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300

# Installs missing Debian packages (1) as root; as another user prints the line to run, then does (2).
define need
	packages="$(strip $(1))"; \
	if [ -n "$$packages" ]; then \
		if [ "$$(id -u)" = 0 ]; then \
			echo "installing $$packages"; \
			{ $(APT) update -qq && DEBIAN_FRONTEND=noninteractive $(APT) install -qq -y --no-install-recommends $$packages; } >/dev/null; \
		else \
			echo "missing on this machine; run: sudo apt-get install --no-install-recommends $$packages" >&2; $(2); \
		fi; \
	fi
endef

include systemd/install.mk
include $(wildcard clients/c/client.mk)
include $(wildcard tests/fuzz/fuzz.mk)

clean:
	rm -rf $(VENV) build *.egg-info firmware/build $(EXTRAS:%=%/build)
