# phantom-dyn: every target sets up what it needs; the second call starts at once.
#   make demo   the main job, end to end          make test   the whole test suite
#   make nightly the long tests that `make test` leaves out: coverage, power and whole studies; then make shapes
#   make shapes tests whose calls are checked against the annotations of shapes
#   make lint   ruff, pyright, import layers      make bench  benchmarks with timing
#   make blind  sealed cases, into docs/           make speed  speed beside other tools, into docs/
#   make lock   renew requirements.txt            make clean  removes the environment and what was built
#   make wheel  the wheel, checked, and used where nothing else is installed
#   make lowest the tests with the lowest versions that pyproject.toml allows [LOWEST=tests/phantom_dyn]
#   make docs   the documentation site, into docs/_build/html
#   make papers the pages of docs/papers: what four papers state beside what is computed
#   make drake  sealed cases of the second make, diagnosed and scored [DRAKE_SEEDS=0:24]
#   make fuzz [MINUTES=10] [SEED=1] [ONLY=]       hostile files until the time is over; failures go to fuzz_failures/
#   make mutants [SAMPLE=150] [SEED=1] [ONLY=]    how many deliberate mistakes in the code the tests notice; SAMPLE=0: all

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
MUTANTS := .venv-mutants
DRAKE := .venv-drake
DRAKE_SEEDS ?= 0:24
LOWEST ?= tests
SAMPLE ?= 150
MINUTES ?= 10
SEED ?= 1
ONLY ?=

export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
# pip and pyright: no hints about newer versions.
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

.DEFAULT_GOAL := test
.PHONY: demo test nightly shapes lint wheel lowest bench blind drake speed mutants fuzz docs papers lock clean setup tools
.DELETE_ON_ERROR:

demo: setup
	@$(BIN)/python examples/demo.py

# Byte code is kept whatever the environment says: else each worker and each process of a test compiles every module.
test: setup
	@env -u PYTHONDONTWRITEBYTECODE $(BIN)/python -m pytest

nightly: setup
	@env -u PYTHONDONTWRITEBYTECODE $(BIN)/python -m pytest -m nightly
	@$(MAKE) --no-print-directory shapes

# Apart from the others, as checks take a third more of the time of all of them.
shapes: setup
	@env -u PYTHONDONTWRITEBYTECODE PHANTOM_DYN_SHAPES=1 $(BIN)/python -m pytest tests

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/pyright --project pyproject.toml
	@$(BIN)/lint-imports --no-cache

wheel: setup
	@.ci/wheel

# As long as `make test`; it has a folder of its own, which stays as long as the versions do.
lowest: setup
	@.ci/lowest $(LOWEST)

bench: setup
	@$(BIN)/python -m pytest benchmarks --benchmark-enable -n 0

blind: setup
	@$(BIN)/python benchmarks/blind/run.py --publish

speed: setup
	@$(BIN)/python benchmarks/speed_table.py

# Drake has a folder of its own, without what it asks for besides: it is too large to be a part of the lock.
drake: setup
	@test -d $(DRAKE) || $(BIN)/python -m pip install -qq --no-deps --target $(DRAKE) "drake>=1.51,<2"
	@$(BIN)/python benchmarks/blind/run.py --make drake --quick \
	  --singles $(DRAKE_SEEDS) --nulls $(DRAKE_SEEDS) --pairs $(DRAKE_SEEDS) --outside $(DRAKE_SEEDS)

# The tool has a folder of its own, as it is no part of the lock; the libraries under test are those of .venv.
mutants: setup
	@test -d $(MUTANTS) || $(BIN)/python -m pip install -qq --target $(MUTANTS) "cosmic-ray>=8.4,<9"
	@PYTHONPATH=$(MUTANTS) $(BIN)/python benchmarks/mutants.py --sample $(SAMPLE) --seed $(SEED) --only "$(ONLY)"

fuzz: setup
	@PYTHONPATH=tests/common $(BIN)/python tests/fuzz/run.py --minutes $(MINUTES) --seed $(SEED) --only "$(ONLY)"

# Any warning fails, and nothing is fetched.
docs: setup
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html
	@echo "The site is docs/_build/html/index.html"

papers: setup
	@$(BIN)/python examples/paper_pages.py

setup: $(STAMP)

# What is installed follows from these two files alone, so the stamp depends on them and on nothing else.
$(STAMP): requirements.txt pyproject.toml
	@$(MAKE) --no-print-directory tools
	@echo "Setting up $(VENV) (first call only; a few minutes and 2 to 3 GB, mostly robot models)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install -qq --require-hashes --requirement requirements.txt
	@$(BIN)/python -m pip install -qq --no-deps --no-build-isolation --editable .
	@touch $@

tools:
	@command -v git >/dev/null || { echo "git is missing: sudo apt install git" >&2; exit 1; }
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) is missing: sudo apt install python3 python3-venv" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "phantom-dyn needs Python 3.11 or later and $(PYTHON) is older: sudo apt install python3.11 python3.11-venv," \
	    "then run make PYTHON=python3.11" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "Python's venv module is missing: sudo apt install python3-venv" >&2; exit 1; }

# Universal, with hashes and without the address of any package index: valid wherever the packages come from.
lock: tools
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@test -x $(BIN)/uv || $(BIN)/python -m pip install -qq uv
	@$(BIN)/uv pip compile pyproject.toml --extra all --group test --group benchmarks --group docs --group dev \
	  --generate-hashes --universal --python-version 3.11 --no-emit-index-url --no-emit-find-links \
	  --no-header --no-annotate --upgrade --quiet --output-file requirements.txt

clean:
	rm -rf $(VENV) $(MUTANTS) $(DRAKE) fuzz_failures build dist demo docs/_build docs/generated .pytest_cache .ruff_cache .hypothesis .benchmarks
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
