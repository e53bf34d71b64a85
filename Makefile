# Two commands set everything up: `make demo` runs the main job on a real image, `make test` the tests.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
# A thread for each process: threads that share tiny matrices cost more than they bring. What arrays leave of the memory is kept
# for the next ones; given back to the system, it would come back page by page.
ALONE := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MALLOC_TRIM_THRESHOLD_=1073741824 MALLOC_MMAP_THRESHOLD_=33554432
BENCH := .venv-bench

.PHONY: results results-full stale-results demo test quick slow kernels check bench foreign fuzz mutants kill large coverage docs docs-figures clean

demo: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/quadriform demo -o out/demo --force

# Byte code is kept, as Python does unless told otherwise, for nearly a hundred processes start on the way.
test: $(READY)
	$(ALONE) PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

# The same without the tests of tests/slow.txt, for every change of a line; no browser to wait for, so a process for each core.
quick: $(READY)
	$(ALONE) PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n $$(getconf _NPROCESSORS_ONLN) --dist loadfile --no-loadscope-reorder \
		-m "not slow"

# Adds to tests/slow.txt what takes the processor more than a quarter of a second.
slow: $(READY)
	$(ALONE) $(BIN)/python tests/robustness/slow_tests.py

# The numerical tests under each kernel of OpenBLAS that the processor has; another kernel rounds as another processor does.
kernels: $(READY)
	PYTHONPATH=tests $(BIN)/python tests/robustness/kernels.py

check: $(READY)
	$(BIN)/ruff check src tests benchmarks docs examples
	$(BIN)/ruff format --check src tests benchmarks docs examples
	$(BIN)/clang-format --dry-run --Werror src/quadriform/shapes/kernel/*
	$(BIN)/mypy -n auto
	$(BIN)/lint-imports
	$(BIN)/python tests/robustness/wording.py
	$(BIN)/python benchmarks/write_results.py --stale

# The baselines stay out of the environment of the tests: what they bring along has pytest plugins of its own.
bench: $(BENCH)/ready
	$(BENCH)/bin/python benchmarks/run.py
	$(BENCH)/bin/python benchmarks/comparisons.py -o BENCHMARK.md

$(BENCH)/ready: pyproject.toml constraints.txt CMakeLists.txt $(wildcard src/quadriform/shapes/kernel/*)
	$(PYTHON) -m venv $(BENCH)
	$(BENCH)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'
	touch $@

# The accuracy tables of the docs, each with date and commit: those that take minutes, or all. Baselines need `make bench` first.
results: $(READY)
	$(BIN)/python benchmarks/write_results.py

results-full: $(BENCH)/ready
	$(BENCH)/bin/python benchmarks/write_results.py --full

# Tables that are older than the code they depend on; an error, for a release.
stale-results: $(READY)
	$(BIN)/python benchmarks/write_results.py --stale --release

# 100,000 damaged files over all readers; a smaller part of it is among the tests.
fuzz: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python tests/robustness/fuzzing.py

# Files of other people, in the wheels of nibabel, pydicom and scikit-image; a few of them are among the tests.
foreign: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python tests/robustness/foreign_files.py

# Fifty whole fits stopped at random instants; a smaller part of it is among the tests.
kill: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python tests/robustness/killed_fits.py

# Ten million points in one GiB of addresses; the tests take 60,000.
large: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/robustness/little_room.py 10000000

# Each guard taken out in a copy, then forty random changes of what is computed, for a test to notice; about half an hour.
mutants: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/robustness/mutants.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/robustness/logic_mutants.py

# Lines and branches that the tests run, and the functions with lines that none runs; slower than the tests alone.
coverage: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder \
		--cov=quadriform --cov-branch --cov-report=json:out/coverage.json --cov-report=
	$(BIN)/python tests/robustness/uncovered.py out/coverage.json

# The site, whether it is whole and asks for nothing elsewhere, and what it shows: tutorials, notebook, gallery.
docs: $(READY)
	$(BIN)/sphinx-build -W --keep-going -q -b html docs out/docs
	$(ALONE) $(BIN)/python -m pytest tests/site_checks.py tests/gallery_checks.py

docs-figures: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/make_figures.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/gallery_figures.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/make_screenshots.py

$(READY): pyproject.toml constraints.txt CMakeLists.txt $(wildcard src/quadriform/shapes/kernel/*)
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

clean:
	rm -rf .venv $(BENCH) out
