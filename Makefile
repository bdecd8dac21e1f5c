# Every target sets up first, which takes 0.1 s when there is nothing to do. See CONTRIBUTING.md.
#     make setup PYTHON=python3.12          choose the Python
#     make run EXE=evaluate ARGS='--help'   run an installed executable
#     make test ARGS='-k resources'         pass options to pytest

RUN := scripts/run
BIN := install/lib/ator_ros
ARGS ?=

.PHONY: setup demo view run test test-long test-apt-versions lint format docs bench reproduce clean

setup:
	@scripts/setup

demo: setup
	@$(RUN) $(BIN)/demo $(ARGS)

# A page in the browser; `make view ARGS='--port 8081'`.
view: setup
	@$(RUN) $(BIN)/view $(ARGS)

# An exit code other than 0 makes make's own exit code 2; `scripts/run $(BIN)/EXE` gives it as it is.
run: setup
	@test -x $(BIN)/$(or $(EXE),$(error which executable? make run EXE=simulation ARGS=...)) || \
		{ echo "EXE=$(EXE): expected one of: $$(ls $(BIN) | tr '\n' ' ')" >&2; exit 2; }
	@$(RUN) $(BIN)/$(EXE) $(ARGS)

# Three workers on two cores, as nodes often wait; libraries of linear algebra have one thread each.
# Each file on one worker, in the order that test/conftest.py sets. Bytecode is kept, whatever the
# shell says, for the processes that are started over and over.
test test-long bench: export OMP_NUM_THREADS = 1
test test-long bench: export OPENBLAS_NUM_THREADS = 1
test: setup
	@PYTHONDONTWRITEBYTECODE= $(RUN) python -m pytest -n 3 --dist loadfile --no-loadscope-reorder -m 'not long' $(ARGS)

# What takes minutes: permutations of faults, every documented command, the site.
test-long: setup
	@-scripts/docs --packages
	@$(RUN) python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m long $(ARGS)

# The core's tests with the versions that Ubuntu 24.04 installs with apt, in an environment of their own.
test-apt-versions: setup
	@scripts/test_apt_versions $(ARGS)

lint: setup
	@$(RUN) ruff check
	@$(RUN) ruff format --check
	@$(RUN) mypy

format: setup
	@$(RUN) ruff check --fix
	@$(RUN) ruff format

# The site in build/docs/html. The first run installs Sphinx; `make docs ARGS='-b linkcheck'` checks links to other sites.
docs: setup
	@scripts/docs $(ARGS)

# How fast refinement, plans, actions and simulation are; on an idle machine.
bench: setup
	@$(RUN) python benchmarks/speed.py $(ARGS)

# Learn the shipped models again from nothing and make every table and figure, in about two hours; ARGS='tour' makes a
# part, ARGS=--list shows the steps.
reproduce: setup
	@$(RUN) python scripts/reproduce.py $(ARGS)

clean:
	rm -rf .venv .venv-apt build install log .mypy_cache .pytest_cache .ruff_cache .hypothesis
	rm -rf docs/generated
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
