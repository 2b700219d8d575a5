# Everything a stranger needs: `make demo` and `make test`. Both set up what they need, once, in .venv.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check
# The mathematics, whose last bits depend on the order in which a processor's BLAS kernel adds. A result that hangs on
# them is a fault. SkylakeX needs AVX-512; elsewhere Sandybridge, which lacks the fused multiply-add, is the other one.
KERNELS := Haswell $(shell grep -qs avx512f /proc/cpuinfo && echo SkylakeX || echo Sandybridge)
MATHEMATICS := $(addprefix tests/calib/, geometry adjustment solving tracking)
# As base-station does for itself: threads of BLAS that spin beside other tests cost more than they bring.
export OPENBLAS_NUM_THREADS ?= 1
SEED ?= $(shell od -An -N4 -tu4 /dev/urandom | tr -d ' ')

.PHONY: setup demo test test-all test-rooms test-whole test-waiting test-tools test-field test-machine test-packages rehearse test-kernels fuzz peers check lock bundle clean

setup: .venv/installed

.venv/installed: pyproject.toml requirements.lock
	@echo "setting up .venv: about 320 MB are fetched once and take up 1.2 GB; nothing outside this folder is changed"
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "$(or $(PYTHON),python3) is no Python 3.11 or later: apt install python3, or name one: make PYTHON=..."; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
		{ echo "$(PYTHON) cannot make an environment: apt install python3-venv"; exit 1; }
	$(PYTHON) -m venv .venv
	$(PIP) install --require-hashes -r requirements.lock
	$(PIP) install --no-deps --no-build-isolation --editable .
	touch $@

demo: setup
	$(BIN)/python -m tools.demo

# The field tests mostly wait (for links to come back, for watchdogs): beside the others they cost hardly any time. The
# installed machine comes after them: it works, and what waits is told late by a busy computer. The tools come last, so that
# both sides end at about the same time.
test: check
	$(MAKE) --no-print-directory --jobs=2 --output-sync=target test-rooms test-whole

# What CI asks for: the packages and both kernels too, beside the rooms that still run when the machines are done.
test-all: check
	$(MAKE) --no-print-directory --jobs=2 --output-sync=target test-rooms test-waiting

test-waiting: setup peers
	$(MAKE) --no-print-directory test-whole
	$(MAKE) --no-print-directory test-packages
	$(MAKE) --no-print-directory --jobs=1 $(addprefix test-kernel-, $(KERNELS))

test-whole: setup
	$(MAKE) --no-print-directory test-field
	$(MAKE) --no-print-directory test-machine
	$(MAKE) --no-print-directory test-tools

test-rooms: setup
	$(BIN)/python -m pytest $(addprefix --ignore=tests/, field machine packages tools)

test-tools: setup
	$(BIN)/python -m pytest tests/tools

test-field: setup
	$(BIN)/python -m pytest tests/field

# What is installed, in a booted machine without a network: as root, with systemd-container and mmdebstrap; else skipped.
test-machine: setup
	$(BIN)/python -m pytest -rs tests/machine

# The Debian packages: built, checked by lintian, and lived with in a booted machine. Minutes, so CI alone asks for it.
test-packages: setup
	$(BIN)/python -m pytest -rs tests/packages

# The same life, told as it goes: a finding a line.
rehearse: setup
	$(BIN)/python -m tools.rehearsal

# The mathematics once on each of two kernels, side by side where nothing else runs.
test-kernels: setup
	$(MAKE) --no-print-directory --jobs=2 --output-sync=target $(addprefix test-kernel-, $(KERNELS))

test-kernel-%: setup
	@echo "the mathematics on OpenBLAS's $* kernels"
	OPENBLAS_CORETYPE=$* $(BIN)/python -m pytest $(MATHEMATICS)

# Every reader of bytes, with other bytes than yesterday. The same again: make fuzz SEED=...
fuzz: setup
	@echo "seed $(SEED)"
	$(BIN)/python -m pytest --hypothesis-profile=fuzz --hypothesis-seed=$(SEED) \
		$(shell grep -rl --include='test_*.py' 'import.* given' tests)

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Other people's ground stations, which a test of MAVLink asks where they are: 150 MB in an environment of their own.
peers: .venv/peers/installed

.venv/peers/installed: tests/peers.lock .venv/installed
	$(PYTHON) -m venv --clear --without-pip .venv/peers
	$(PIP) --python .venv/peers/bin/python install --no-deps --no-compile --require-hashes -r tests/peers.lock
	$(BIN)/python -c 'import sys; print(*(each for each in sys.path if each.endswith("site-packages")), sep="\n")' > \
		$$(.venv/peers/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/ours.pth
	touch $@

# The versions and hashes that everybody gets. pip-tools has an environment of its own: nobody else needs it.
lock:
	$(PYTHON) -m venv .venv/lock
	.venv/lock/bin/python -m pip install --quiet --disable-pip-version-check 'pip-tools>=7.5,<8'
	.venv/lock/bin/python -m piptools compile --quiet --strip-extras --generate-hashes --allow-unsafe \
		--no-emit-index-url --no-emit-trusted-host --no-emit-find-links \
		--extra box --extra base --extra page --extra certs --extra frames --extra test \
		--output-file requirements.lock pyproject.toml

bundle: setup
	$(BIN)/python -m tools.bundle

clean:
	rm -rf .venv out build dist *.egg-info
