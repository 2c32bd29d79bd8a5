# Installs fmfts into a prefix, or makes a Debian package; the Makefile includes this file.

PREFIX ?= /usr/local
DESTDIR ?=
SYSTEM_PYTHON ?= /usr/bin/python3
# WITHOUT_DEPENDENCIES=1: pip installs no dependencies with the package (the Debian package brings its own).
WITHOUT_DEPENDENCIES ?=

# Extras that every installation on a system has.
INSTALL_EXTRAS := extras/calibrate extras/collect extras/fleet extras/magnet extras/page extras/recording extras/report extras/simulation extras/skin

INSTALL_LIB := $(PREFIX)/lib/fmfts
# systemd and udev search for these files below /usr/local/lib as well as /usr/lib.
INSTALL_FILES := $(PREFIX)/bin/fmfts-daemon $(PREFIX)/lib/systemd/system/fmfts.service \
	$(PREFIX)/lib/sysusers.d/fmfts.conf $(PREFIX)/lib/udev/rules.d/60-fmfts.rules
# umask 022: root's own umask may be stricter, and then the service's user could not read the files.
# Ubuntu 22.04's pip takes no --root-user-action, but leaves out a variable that it does not know; and without this layout it
# does not find the setuptools that it fetched for the build.
LAYOUT := $(shell grep -qs '^VERSION_CODENAME=jammy' /etc/os-release && echo DEB_PYTHON_INSTALL_LAYOUT=deb_system)
PIP_TARGET = umask 022 && PIP_ROOT_USER_ACTION=ignore $(LAYOUT) $(SYSTEM_PYTHON) -m pip install --quiet --disable-pip-version-check --no-warn-script-location \
	--no-compile --target "$(DESTDIR)$(INSTALL_LIB)"
IN_PLACE = sed -e 's|@LIB@|$(INSTALL_LIB)|g' -e 's|@PYTHON@|$(SYSTEM_PYTHON)|' -e 's|/usr/bin/fmfts-daemon|$(PREFIX)/bin/fmfts-daemon|'

INSTALL_PACKAGES = $(call missing_packages,python3-pip python3-dev gcc)
DEB_PACKAGES = $(call missing_packages,debhelper dh-python build-essential python3-pip python3-dev)

.PHONY: install uninstall deb reproducible lint-deb drill-service test-fresh test-busy drills soak aarch64 same-numbers

install:
	@$(call need,$(INSTALL_PACKAGES),exit 1)
	rm -rf "$(DESTDIR)$(INSTALL_LIB)"
	$(PIP_TARGET) $(if $(WITHOUT_DEPENDENCIES),--no-deps) ./clients/python . $(INSTALL_EXTRAS:%=./%)
	find "$(DESTDIR)$(INSTALL_LIB)/bin" -type f ! -name fmfts-daemon -delete
	install -d -m 755 $(foreach file,$(INSTALL_FILES),"$(DESTDIR)$(dir $(file))") "$(DESTDIR)/etc/fmfts"
	$(IN_PLACE) systemd/fmfts-daemon.sh | install -m 755 /dev/stdin "$(DESTDIR)$(PREFIX)/bin/fmfts-daemon"
	$(IN_PLACE) systemd/fmfts.service | install -m 644 /dev/stdin "$(DESTDIR)$(PREFIX)/lib/systemd/system/fmfts.service"
	install -m 644 systemd/fmfts.sysusers "$(DESTDIR)$(PREFIX)/lib/sysusers.d/fmfts.conf"
	install -m 644 systemd/60-fmfts.rules "$(DESTDIR)$(PREFIX)/lib/udev/rules.d/60-fmfts.rules"
	test -e "$(DESTDIR)/etc/fmfts/config.toml" || install -m 644 config.toml "$(DESTDIR)/etc/fmfts/config.toml"
	@$(if $(DESTDIR),:,systemd-sysusers $(PREFIX)/lib/sysusers.d/fmfts.conf && { test ! -d /run/systemd/system || { systemctl daemon-reload && udevadm control --reload; }; })
	@$(if $(DESTDIR),:,echo "describe your pads in /etc/fmfts/config.toml$(,) then: systemctl enable --now fmfts")

# Configuration and baselines belong to the user; they stay.
uninstall:
	@$(if $(DESTDIR),:,test ! -d /run/systemd/system || systemctl disable --now fmfts)
	rm -rf "$(DESTDIR)$(INSTALL_LIB)"
	rm -f $(foreach file,$(INSTALL_FILES),"$(DESTDIR)$(file)")
	@echo "left in place: $(DESTDIR)/etc/fmfts (configuration), $(DESTDIR)/var/lib/fmfts (baselines), user and group fmfts"

, := ,

VERSION = $(shell sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
DEB_BUILD := build/deb
# The time of the commit, so that the same commit gives the same package; without git, that of CHANGELOG.md.
SOURCE_DATE_EPOCH ?= $(shell git log -1 --format=%ct 2>/dev/null || stat -c %Y CHANGELOG.md)
DEB_SOURCES := Makefile pyproject.toml setup.py README.md CHANGELOG.md LICENSE config.toml daemon docs clients/python $(INSTALL_EXTRAS) systemd

# A package for the Debian or Ubuntu that builds it, in build/. It fetches what that lacks from PyPI, by hash
# (systemd/debian/vendored.txt).
deb:
	@$(call need,$(DEB_PACKAGES),exit 1)
	rm -rf $(DEB_BUILD) && mkdir -p $(DEB_BUILD)/fmfts
	tar -c --exclude=__pycache__ --exclude='*.so' --exclude='*.egg-info' --exclude='extras/*/build' --mtime=@$(SOURCE_DATE_EPOCH) $(DEB_SOURCES) | tar -x -C $(DEB_BUILD)/fmfts
	sed -n 's/^\(setuptools==[^ ]*\).*/\1/p' release/constraints-build.txt > $(DEB_BUILD)/fmfts/setuptools.txt
	cp -r systemd/debian $(DEB_BUILD)/fmfts/debian
	printf 'fmfts (%s) %s; urgency=medium\n\n  * See CHANGELOG.md.\n\n -- The fmfts authors <fmfts@example.invalid>  %s\n' \
		$(VERSION) "$$(. /etc/os-release && echo $$VERSION_CODENAME)" "$$(LC_ALL=C date -u -R -d @$(SOURCE_DATE_EPOCH))" > $(DEB_BUILD)/fmfts/debian/changelog
	cd $(DEB_BUILD)/fmfts && SOURCE_DATE_EPOCH=$(SOURCE_DATE_EPOCH) dpkg-buildpackage --no-sign --build=binary
	mv $(DEB_BUILD)/fmfts_$(VERSION)_*.deb build/
	@ls -l build/fmfts_$(VERSION)_*.deb

# Two builds of HEAD in different folders, zones, languages, modes and times give the same bytes. QUICK=1: not for aarch64, nothing compressed.
reproducible: $(VENV)/.installed-test
	@$(call need,$(DEB_PACKAGES) $(if $(QUICK),,$(call missing_packages,debootstrap)),exit 1)
	@$(BIN)/pip install --quiet --disable-pip-version-check -e clients/python -e '.[dist]'
	$(BIN)/python tests/drills/reproducible.py $(if $(QUICK),--quick)

# Fails on any error that lintian finds in the package.
lint-deb: deb
	@$(call need,$(call missing_packages,lintian),exit 1)
	lintian --fail-on error build/fmfts_$(VERSION)_$(shell dpkg --print-architecture).deb

# The package on a plain Debian 12 under real systemd (root; ten minutes the first time, then five).
drill-service: deb firmware
	@$(call need,$(call missing_packages,debootstrap systemd-container),exit 1)
	$(PYTHON) tests/drills/service.py build/fmfts_$(VERSION)_$(shell dpkg --print-architecture).deb

# The package and an installation with pip on plain trees of Debian 12 and 13, Ubuntu 22.04 and 24.04 (root; network; ten minutes
# each). Only some: SYSTEMS="ubuntu-22.04".
SYSTEMS ?=
.PHONY: test-systems
test-systems:
	@$(call need,$(call missing_packages,debootstrap systemd-container git),exit 1)
	$(PYTHON) tests/drills/systems.py $(SYSTEMS)

# A fresh clone of HEAD on a plain Debian 12 (root). QUICK=1: the installation, lint and unit tests (ten minutes). CPU=v1, v2
# or v3: the arithmetic that an older processor would choose.
QUICK ?=
CPU ?=
test-fresh:
	@$(call need,$(call missing_packages,debootstrap systemd-container git),exit 1)
	$(PYTHON) tests/drills/fresh_clone.py $(if $(QUICK),--quick) $(if $(CPU),--cpu $(CPU))

# The demo and all tests TURNS times in turn, each in a fresh clone on a plain Debian 12 and beside two endless loops, on
# this processor's arithmetic and on that of older ones (root; 20 to 36 minutes a turn). Only some parts: BUSY="--parts lint clock".
TURNS ?= 5
BUSY ?=
test-busy: $(VENV)/.installed-test
	@$(call need,$(call missing_packages,debootstrap systemd-container git),exit 1)
	$(BIN)/python tests/drills/busy_suites.py --turns $(TURNS) $(BUSY)

# All recovery drills (half an hour; nothing else may run): docs/recovery.md.
drills: test-packages $(VENV)/.installed-test
	$(BIN)/python tests/drills/recovery.py

# Sixteen pads with random faults; shorter with SOAK="--pads 4 --seconds 60".
SOAK ?= --pads 16 --seconds 600
soak: test-packages $(VENV)/.installed-test
	$(BIN)/python tests/drills/soak.py $(SOAK)

# The wheel for aarch64, and tests under qemu.
aarch64: test-packages $(VENV)/.installed-test
	@$(call need,$(call missing_packages,debootstrap python3-pip),exit 1)
	$(BIN)/python tests/drills/aarch64.py

# Replays recordings with the arithmetic of other processors, also aarch64.
same-numbers: test-packages $(VENV)/.installed-test
	@$(call need,$(call missing_packages,debootstrap python3-pip),exit 1)
	$(BIN)/python tests/drills/same_numbers.py --aarch64
