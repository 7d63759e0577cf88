# `make demo` and `make test` work on a bare clone: they make .venv, install the tested versions, and compile the kernels,
# which tests in several processes would each compile for themselves.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo test lint types tests test-portable wheel bench docs notebooks report full-report format clean

demo: $(STAMP)
	$(BIN)/tactopose demo

# Three things at a time: mypy keeps one core busy for the better part of a minute.
test: $(STAMP)
	$(MAKE) --no-print-directory -j3 lint types tests

lint: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(STAMP)
	$(BIN)/mypy

tests: $(STAMP)
	$(BIN)/pytest

# The same tests, or those that TESTS names, under the plainest instruction set of this kind of processor. The compiled
# kernels, NumPy, OpenBLAS and the C library's functions round otherwise there, so what passes here as well rests on no
# processor's last bits. Nothing that was compiled or computed for this machine is taken over; kernels are compiled first,
# which the tests' processes would each do for themselves.
TESTS ?= tests
PLAIN_BLAS := $(if $(filter x86_64,$(shell uname -m)),Nehalem,ARMV8)
FOUND_BY_NUMPY := import numpy; print(*numpy.show_config(mode="dicts")["SIMD Extensions"].get("found", []))

PLAIN = NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR=$(CURDIR)/out/portable/kernels \
	TACTOPOSE_CACHE_DIR=$(CURDIR)/out/portable/models \
	NPY_DISABLE_CPU_FEATURES="$$($(BIN)/python -c '$(FOUND_BY_NUMPY)')" \
	OPENBLAS_CORETYPE=$(PLAIN_BLAS) GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4

test-portable: $(STAMP)
	$(PLAIN) $(BIN)/tactopose warm-up
	$(PLAIN) $(BIN)/pytest $(TESTS)

# A wheel for this version of Python on Linux and x86-64, with its kernels compiled.
wheel: $(STAMP)
	HATCH_BUILD_HOOK_ENABLE_CUSTOM=true $(BIN)/pip wheel --no-deps --no-build-isolation --wheel-dir dist .

bench: $(STAMP)
	$(BIN)/pytest -n 0 -s tests/benchmarks

# A few trials of everything, some minutes, two scripts at a time; `full-report` makes all of them, in an hour or two.
report: $(STAMP)
	$(BIN)/python examples/report.py

full-report: $(STAMP)
	$(BIN)/python examples/report.py --full

docs: $(STAMP)
	$(BIN)/sphinx-build -b html -q -W docs out/docs
	@echo "The documentation is out/docs/index.html."

# Runs the notebooks and stores what they print and draw, but for the cells with the tag `page`, whose pages are too large.
notebooks: $(STAMP)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[notebook]'
	$(BIN)/jupyter nbconvert --to notebook --execute --inplace --ExecutePreprocessor.record_timing=False notebooks/*.ipynb
	$(BIN)/jupyter nbconvert --to notebook --inplace --TagRemovePreprocessor.enabled=True \
	  --TagRemovePreprocessor.remove_all_outputs_tags=page notebooks/*.ipynb

format: $(STAMP)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; PYTHON=/path/to/python3.11 make ... names one")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check 'pip>=25.1'
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt --group dev -e .
	$(BIN)/tactopose warm-up
	@touch $@

clean:
	rm -rf $(VENV) out
