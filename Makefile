# Two commands do everything on a fresh machine: `make demo` and `make test`.
# Every target first sets up what it needs (scripts/prepare.py); that costs nothing once it is done.

PYTHON ?= python3
ROOMS := cli configs core evaluate render spheresets tables
RUN := .venv/bin/python -m

.PHONY: help demo test check bench bench-fits fresh prepare browser

help:
	@echo "make demo         the main job: from the bunny to a measured picture, out/demo/report.html"
	@echo "make test         all tests"
	@echo "make check        style, format and types"
	@echo "make bench        measure speed, see benchmarks/"
	@echo "make bench-fits   measure sphere fits beside a rival's, see benchmarks/"
	@echo "make fresh        prove the set-up in an empty root (needs root and debootstrap)"

demo: prepare
	.venv/bin/coslobe demo

test: prepare browser
	$(RUN) pytest

check: prepare
	$(RUN) ruff check .
	$(RUN) ruff format --check .
	mkdir -p build/typing/coslobe
	for room in $(ROOMS); do ln -sfn ../../../$$room build/typing/coslobe/$$room; done
	$(RUN) pyright

bench: prepare
	@$(PYTHON) scripts/prepare.py llvm
	.venv/bin/python benchmarks/run.py

bench-fits: prepare
	.venv/bin/python benchmarks/fits.py

fresh:
	scripts/fresh.sh

prepare:
	@$(PYTHON) scripts/prepare.py

browser:
	@$(PYTHON) scripts/prepare.py browser
