# Everything a stranger needs: `make demo` and `make test`. Both set up what they need, once, in .venv.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin

.PHONY: setup demo test test-rooms test-field check lock bundle clean

setup: .venv/installed

.venv/installed: pyproject.toml requirements.lock
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --editable .
	touch $@

demo: setup
	$(BIN)/python -m tools.demo

# The field tests mostly wait (for links to come back, for watchdogs): beside the others they cost hardly any time.
test: check
	$(MAKE) --no-print-directory --jobs=2 --output-sync=target test-rooms test-field

test-rooms: setup
	$(BIN)/python -m pytest --ignore=tests/field

test-field: setup
	$(BIN)/python -m pytest tests/field

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

lock:
	$(BIN)/python -m piptools compile --quiet --strip-extras --no-emit-index-url --no-emit-trusted-host --no-emit-find-links \
		--extra base --extra page --extra certs --extra test --output-file requirements.lock pyproject.toml

bundle: setup
	$(BIN)/python -m tools.bundle

clean:
	rm -rf .venv out build dist *.egg-info
