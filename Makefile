# make demo | test | test-all | bench [ONLY=name, or help] | setup | docs | lint | clean
SHELL := /bin/bash
RUN := . ./env.sh &&

.PHONY: setup demo test test-all bench docs lint clean
setup:
	@bash scripts/setup.sh
demo: setup
	@$(RUN) waam demo
test:
	@bash scripts/setup.sh --test --robot
	@$(RUN) ruff check . && bash scripts/test.sh
test-all:
	@bash scripts/setup.sh --test --train --robot
	@$(RUN) ruff check . && bash scripts/test.sh --all
bench:
	@bash scripts/setup.sh --test --robot
	@$(RUN) python3 bench/run.py $(ONLY)
docs:
	@bash scripts/setup.sh --test
	@$(RUN) python3 scripts/docs_site.py
lint:
	@bash scripts/setup.sh --test
	@$(RUN) ruff format . && ruff check --fix . && mypy && waam_ws/src/waam_firmware/lint.sh
clean:
	rm -rf waam_ws/build waam_ws/install waam_ws/log site .venv .setup.*
