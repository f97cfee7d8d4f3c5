# Everything runs in .venv, made here from the hashed locks. Needs python3 (>= 3.11, with venv) and make.
#   make PYTHON=python3.13 test    uses another Python (after `make clean`)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
LOCKED := $(VENV)/.locked
INSTALLED := $(VENV)/.installed
LOCKS := requirements-build.lock requirements.lock
# What is compiled when the package is installed, and what it is made with. A folder is newer after a
# file was removed from it.
KERNELS := $(shell sed -n '/^\[tool.sweepctl.kernels\]/,/^\[/s/.*"\(.*\.py\)".*/\1/p' pyproject.toml)
MADE_WITH := setup.py requirements-build.lock tools/dev/kernels.py \
	$(shell find protocol bridge sim_device tools -name '*.pxd') \
	$(foreach folder,board_library board_virtual core include protocol,$(wildcard \
		sim_device/firmware/$(folder) sim_device/firmware/$(folder)/*.[ch]))
# The C compiler that this Python was built with; where that is missing another one, else that of the
# lock, which is told to compile for any CPU of this kind and not for the one that it runs on.
OWN_CC := $(shell command -v $$($(PYTHON) -c 'import sysconfig; print((sysconfig.get_config_var("CC") or "cc").split()[0])' 2>/dev/null))
ifeq ($(OWN_CC),)
KERNEL_CC := $(or $(shell command -v $(CC)),$(BIN)/python -m ziglang cc -mcpu=baseline -fno-sanitize=undefined)
KERNEL_ENV := CC='$(KERNEL_CC)' LDSHARED='$(KERNEL_CC) -shared'
endif
# A dot for each package on the screen, everything in a log. Where packages come from is the
# user's own setting.
define pip_install
{ $(BIN)/python -m pip --disable-pip-version-check install $(1) 2>&1; echo "exit $$?"; } \
	| tee -a $(VENV)/install.log \
	| awk '/^(Collecting|Processing|Obtaining)/ { printf "."; fflush() } \
		/^Installing collected/ { printf " unpacking"; fflush() } \
		/^exit / { code = $$2 } END { print ""; exit code }' \
	|| { grep -aiE '^ *error' $(VENV)/install.log; \
		echo 'pip failed; the whole story is in $(VENV)/install.log' >&2; exit 1; }
endef
# Used only by `make lock`.
UV := uv==0.13.8
COMPILE := $(BIN)/uv pip compile --quiet --universal --generate-hashes --python-version 3.11 \
	--no-header --no-emit-index-url --no-emit-find-links

# The tests start hundreds of Python processes: without bytecode each compiles our modules anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help venv check test nightly demo lint types imports fast unit statistics coverage covered bench firmware qemu campaign generated docs fmt lock clean soak mutants

help: ## list the targets
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /\1\t/' \
		| while IFS="$$(printf '\t')" read -r name text; do printf '  make %-8s %s\n' "$$name" "$$text"; done

check: lint types imports fast ## lint, types, import rules, fast tests: two minutes

test: lint types imports unit ## lint, types, import rules, tests: 8 to 20 minutes

nightly: covered statistics campaign mutants ## what `test` leaves out: hours

demo: venv ## a simulated clean, then a live one over a pseudo-terminal
	@$(BIN)/python -m tools.dev.demo

lint: venv ## ruff: rules and format; spelling; no retired word in an identifier
	@echo '== lint'
	@$(BIN)/ruff check --quiet
	@$(BIN)/ruff format --check --quiet
	@$(BIN)/codespell
	@$(BIN)/python -m tools.dev.vocabulary

types: venv ## mypy --strict
	@echo '== types'
	@$(BIN)/mypy

imports: venv ## who may import whom
	@echo '== import rules'
	@$(BIN)/lint-imports

# PHASES are runs of pytest, of which each begins whatever became of the one before.
PHASES = PYTHONPATH=tests $(BIN)/python -m support.phases
fast: venv
	@$(PHASES) check $(TEST_OPTIONS)

statistics: venv
	@$(PHASES) nightly $(TEST_OPTIONS)

unit: venv ## the tests; ARGS='-k name' chooses
ifeq ($(strip $(ARGS)),)
	@$(PHASES) test $(TEST_OPTIONS)
else
	@echo '== tests'
	@$(BIN)/python -m pytest -q $(ARGS)
endif

coverage: venv ## the tests with branch coverage, which takes them half as long again
	@PYTHONPATH=tests $(BIN)/python -m pytest -q -p support.sources --cov --cov-report=term $(ARGS)

covered: venv ## branch coverage of the safety code, which must reach its gate
	@PYTHONPATH=tests $(BIN)/python -m mutation.covered

bench: venv ## speed of wire, round trip, runs, recording, export, decisions; memory over an hour
	@PYTHONPATH=tests $(BIN)/python -m bench.wire
	@PYTHONPATH=tests $(BIN)/python -m bench.round_trip
	@PYTHONPATH=tests $(BIN)/python -m bench.simulate --target python --target core --target library
	@PYTHONPATH=tests $(BIN)/python -m bench.record
	@PYTHONPATH=tests $(BIN)/python -m bench.export
	@PYTHONPATH=tests $(BIN)/python -m bench.library
	@PYTHONPATH=tests $(BIN)/python -m bench.decisions
	@PYTHONPATH=tests $(BIN)/python -m bench.memory

FIRMWARE = PATH="$(CURDIR)/$(BIN):$$PATH" $(MAKE) --no-print-directory --silent -C sim_device/firmware
firmware: venv ## the firmware for its chips, in build/firmware: flash, RAM, stack of the boards
	@echo 'Macros: $(or $(DEFINES),none (DEFINES sets them))'
	@$(FIRMWARE) boards BUILD=$(CURDIR)/build/firmware
	@$(BIN)/python -m tools.dev.firmware_report build/firmware/boards
	@echo "Core with small buffers on a Cortex-M3 (64 KiB of flash, 20 KiB of RAM in an STM32F103):"
	@$(FIRMWARE) small BUILD=$(CURDIR)/build/firmware
	@$(FIRMWARE) misra

qemu: venv ## a clean of case 1 by the firmware in QEMU, in real time: four minutes
	@PYTHONPATH=tests $(BIN)/python -m bench.qemu_clean

FUZZ_S ?= 60
campaign: venv ## ten million damaged frames, FUZZ_S=60 seconds of fuzzing for each reader, damaged logs
	@PYTHONPATH=tests nice $(BIN)/python -m campaign.corruption
	@for target in parser link codec batch can; do \
		echo "== fuzzing $$target"; \
		PYTHONPATH=tests nice $(BIN)/python -m fuzz.run $$target -max_total_time=$(FUZZ_S) \
			-verbosity=0 -print_final_stats=1 || exit 1; \
	done
	@PYTHONPATH=tests nice $(BIN)/python -m campaign.recovery

soak: venv ## 500 runs with random faults, a simulated day, ten minutes of a full line: hours
	@PYTHONPATH=tests nice $(BIN)/python -m soak.faults --runs 500
	@PYTHONPATH=tests nice $(BIN)/python -m soak.line --minutes 10
	@PYTHONPATH=tests nice $(BIN)/python -m soak.line --minutes 1 --noise
	@PYTHONPATH=tests nice $(BIN)/python -m soak.day --hours 24

mutants: venv ## change the safety code in every small way and see a test fail: an hour or more
	@PYTHONPATH=tests nice $(BIN)/python -m mutation.run

GENERATORS = api_reference command_help file_reference firmware_tables json_schemas planner_reference run_columns
generated: venv ## every generated file of the repository: codec, specification, tables, reference pages
	@$(BIN)/python -m tools.sweepctl generate c --out sim_device/firmware/protocol --force
	@$(BIN)/python -m tools.sweepctl generate md --out docs/protocol --force
	@for name in $(GENERATORS); do $(BIN)/python -m tools.dev.$$name || exit; done
	@$(BIN)/python -m tools.cli.fault_help > docs/faults.md
	@$(BIN)/python -m tools.dev.pin_pictures --out docs/images
	@PYTHONPATH=tests $(BIN)/python -m support.tools

docs: venv ## the documentation as a site in build/docs; a broken link is an error
	@$(BIN)/python -m tools.dev.command_help
	@$(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs
	@echo 'open build/docs/index.html'

fmt: venv ## let ruff format and fix what it can
	@$(BIN)/ruff format
	@$(BIN)/ruff check --fix

lock: $(LOCKED) ## resolve the locks anew
	@$(call pip_install,'$(UV)')
	@$(COMPILE) --upgrade --group build -o requirements-build.lock
	@$(COMPILE) --upgrade --all-extras -c requirements-build.lock -o requirements.lock pyproject.toml
	@echo 'wrote $(LOCKS)'

clean: ## remove .venv and caches
	@rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis .coverage

venv: $(INSTALLED)

# Exactly what the locks name, built only by what they name: first the build tools, then the rest.
# Without dependency resolution: pip 23 takes a newer release of a package that another one names
# with an extra, and then finds no hash for it.
$(LOCKED): $(LOCKS)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		echo "sweepctl needs Python 3.11 or newer; '$(PYTHON)' is $$($(PYTHON) --version 2>/dev/null || echo missing)." >&2; \
		echo 'Name another one: make PYTHON=python3.12 …' >&2; exit 1; }
	@test -f "$$($(PYTHON) -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h" || { \
		echo "Python's C headers are missing (on Debian: apt install $$($(PYTHON) -c 'import sys; print("python3.%d-dev" % sys.version_info[1])'), or python3-dev)." >&2; exit 1; }
	@echo "== making $(VENV) ($$($(PYTHON) --version))"
	@rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV) || { \
		echo 'This Python cannot make a virtual environment (on Debian: apt install python3-venv).' >&2; \
		rm -rf $(VENV); exit 1; }
	@echo '== installing the build tools'
	@$(call pip_install,--no-deps --require-hashes -r requirements-build.lock)
	@echo '== installing the locked packages (a minute or more, 2 GB unpacked)'
	@$(call pip_install,--no-deps --require-hashes --no-build-isolation -r requirements.lock)
	@touch $@

$(INSTALLED): $(LOCKED) pyproject.toml $(KERNELS) $(MADE_WITH)
	@echo '== installing sweepctl itself, compiling what changed (a minute for all of it)'
	@$(KERNEL_ENV) $(BIN)/python setup.py --quiet build_ext --inplace >>$(VENV)/install.log 2>&1 \
		|| { tail -n 20 $(VENV)/install.log >&2; exit 1; }
	@$(call pip_install,--no-deps --no-build-isolation --config-settings editable_mode=compat -e .)
	@# Where Python may not write bytecode, each start would compile all modules anew: 0.2 s.
	@$(BIN)/python -m compileall -q protocol bridge sim_device tools sweepctl_plugins.py
	@for flags in '-g -fsanitize=undefined' '-O1 -g -fsanitize=undefined' -Os; do \
		echo 'int main(void) { return 0; }' \
		| $(BIN)/python -m ziglang cc $$flags -fsanitize-trap=undefined -x c - -lm -o $(VENV)/.compiled || exit 1; \
	done; rm -f $(VENV)/.compiled
	@touch $@
