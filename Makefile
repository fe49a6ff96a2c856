# Two commands do everything, each by itself, in a fresh clone: `make bench` and `make test`.
PYTHON ?= python3
BIN := .venv/bin
# byte code is kept: without it every process compiles the bench anew, and pytest all assertions, for ten seconds
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup bench test test-all test-plain test-oldest test-bounds mutants stress lint full report dist docs web clean

help:
	@echo "make setup   set up and nothing else; then: source .venv/bin/activate"
	@echo "make bench   set up, run the quick profile (about 4 minutes), draw the report and print where it is"
	@echo "make test    set up, run the tests (about 5 minutes)"
	@echo "make test-all  the slow tests, too: clusters, pages in a browser, engines, oldest packages, mutations, stress (about two hours)"
	@echo "make test-plain    the tests as on a plain x86 processor, whose sums and roots round otherwise: no AVX, no fused operations"
	@echo "make stress  repeat the tests that start processes beside busy loops (hours); ROUNDS=30"
	@echo "make test-oldest   the tests with the oldest versions of all packages (tests/oldest.txt), in .venv-oldest"
	@echo "make test-bounds   the tests of methods and experiments, with every index of a kernel checked"
	@echo "make mutants   make one mistake after the other in a copy, and see that a test fails (an hour)"
	@echo "make full    set up, run the full profile (about an hour), draw the report and print where it is"
	@echo "make report  draw the committed reference run again, computing nothing"
	@echo "make docs    write the reference of all public names to build/docs, to be read offline"
	@echo "make dist    build wheel and sdist, install the wheel alone and run it from an empty folder, without heyoka"
	@echo "make web     install the engines of the web (npm), follow bodies in them, and store the rows in lagrange_bench/results/local/full"
	@echo "make lint    ruff and mypy"
	@echo "make clean   remove what the commands above made, results of your own excepted"

setup: .venv/bench
	@echo "ready: source .venv/bin/activate"

bench full: SHELL = bash

bench: .venv/bench
	set -o pipefail; $(BIN)/lagrange-bench run --profile quick | sed '/^next: /d'; status=$$?; \
	$(BIN)/lagrange-bench report --results quick && exit $$status

full: .venv/bench
	set -o pipefail; $(BIN)/lagrange-bench run --profile full | sed '/^next: /d'; status=$$?; \
	$(BIN)/lagrange-bench report --results full && exit $$status

report: .venv/bench
	$(BIN)/lagrange-bench report

# short runs need no compiler; their kernels would take longer to compile than to run
INTERPRETED = NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -n auto -q tests/test_integrators -m
COMPILED = $(BIN)/python -m pytest -n auto --dist loadgroup -q -m

test: .venv/ready
	$(INTERPRETED) "interpreted and not slow"
	$(COMPILED) "not interpreted and not slow"

# before a release, and after a change to the runner, the page or the packages: about two hours
test-all: .venv/ready .venv/engines
	$(INTERPRETED) interpreted
	$(COMPILED) "not interpreted"
	$(MAKE) test-plain test-oldest test-bounds mutants
	$(MAKE) stress ROUNDS=1

ROUNDS ?= 30
stress: .venv/ready
	@for i in $$(seq $$((2 * $$(nproc)))); do $(BIN)/python -c "while True: pass" & loops="$$loops $$!"; done; \
	trap "kill $$loops" EXIT; for round in $$(seq $(ROUNDS)); do \
		$(BIN)/python -m pytest -m processes -q -p no:cacheprovider -n auto --dist loadgroup || exit 1; done

test-plain: export NPY_DISABLE_CPU_FEATURES = X86_V3 X86_V4
test-plain: export OPENBLAS_CORETYPE = Prescott
test-plain: export NUMBA_CPU_NAME = generic
test-plain: export GLIBC_TUNABLES = glibc.cpu.hwcaps=-AVX2,-FMA
test-plain: test

test-oldest: BIN = .venv-oldest/bin
test-oldest: .venv-oldest/ready
	$(INTERPRETED) interpreted
	$(COMPILED) "not interpreted"

test-bounds: .venv/ready
	NUMBA_BOUNDSCHECK=1 $(COMPILED) "not interpreted" tests/test_integrators tests/test_experiments

mutants: .venv/ready
	$(BIN)/python tests/mutants.py

dist:
	$(PYTHON) -m venv --clear .venv-dist
	.venv-dist/bin/pip install --quiet --disable-pip-version-check build
	rm -rf build dist
	.venv-dist/bin/python -m build --outdir dist . >/dev/null
	$(PYTHON) -m venv --clear .venv-dist
	.venv-dist/bin/pip install --quiet --disable-pip-version-check dist/*.whl
	.venv-dist/bin/pip uninstall --quiet --yes heyoka
	folder=$$(mktemp -d) && trap "rm -rf $$folder" EXIT && bench=$(CURDIR)/.venv-dist/bin/lagrange-bench && cd $$folder && \
	$$bench run paper --profile quick --results rows --quiet && $$bench report --results rows --quiet
	@ls dist/*

# without JIT, kernels show their signature and docstring; with ALLOW_EXEC, NumPy before 2.1 may run lscpu when imported
docs: .venv/ready
	NUMBA_DISABLE_JIT=1 PDOC_ALLOW_EXEC=1 $(BIN)/pdoc -d numpy -o build/docs lagrange_bench '!lagrange_bench[.]experiments[.]engines[.].*_run'
	@echo build/docs/lagrange_bench.html

# engines that run in node; their rows are judged and stored by the experiment, like all others
web: .venv/bench
	npm install --prefix lagrange_bench/experiments/engines/web --no-audit --no-fund --no-package-lock
	$(BIN)/lagrange-bench run engines --profile full --no-timings

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	mkdir -p build
	$(BIN)/python -c 'import lagrange_bench; print("from lagrange_bench import", ", ".join(lagrange_bench.__all__))' >build/user.py
	$(BIN)/mypy --strict --follow-imports=silent build/user.py
	$(BIN)/lint-imports --no-logo

# A stamp for each set of extras: none, for who only runs and draws; and those of tests and lint, which include the former.
.venv/made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; set PYTHON=…")'
	$(PYTHON) -m venv .venv
	@touch $@

.venv/bench: pyproject.toml | .venv/made
	@echo "installing into .venv: about 900 MB, two minutes"
	$(BIN)/pip install --quiet --disable-pip-version-check --editable .
	@touch $@

.venv/ready: pyproject.toml | .venv/made
	@echo "installing into .venv, with what the tests need: about 1 GB, two minutes"
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test,lint]'
	@touch .venv/bench $@

.venv/engines: .venv/ready
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[engines]'
	@touch $@

.venv-oldest/ready: pyproject.toml tests/oldest.txt
	$(PYTHON) -m venv .venv-oldest
	.venv-oldest/bin/pip install --quiet --disable-pip-version-check --constraint tests/oldest.txt --editable '.[test]'
	@touch $@

clean:
	rm -rf .venv .venv-oldest .venv-dist build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .grimp_cache .hypothesis
	rm -rf lagrange_bench/results/reference/page lagrange_bench/results/local/*/page
