# Every command a person or the continuous integration needs; `make help` lists them.
# The work is done by the small scripts in scripts/, so that each can also be run alone.

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup web demo test check faults bench bench-record bench-times bench-peers bench-registration

help: ## list these commands
	@awk 'BEGIN { FS = ":.*## " } /^[a-z-]+:.*## / { printf "  make %-18s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

web: ## bundle the page into web/dist, which the server carries
	@scripts/web.sh

demo: ## build, prepare a real head and serve the page at a printed address
	@scripts/demo.sh

test: ## set up what is missing, then format, lints and every test, the browser's included
	@scripts/setup.sh test
	@scripts/test.sh all

check: ## format, lints and the fast tests, with nothing installed
	@scripts/test.sh fast

faults: ## attack the program with everything in tests/faults/ and show what it does to it
	@scripts/faults.sh

bench: ## count the instructions of every hot step and compare with the recorded base (without valgrind: times)
	@scripts/bench.sh

bench-record: ## record the counted instructions as the base
	@scripts/bench.sh record

bench-times: ## the time of every hot step
	@scripts/bench.sh times

bench-peers: ## measure other programs on the same head, turn by turn with ours
	@scripts/bench-peers.sh

bench-registration: ## how far registrations of synthetic pairs are off, ours and SimpleITK's
	@scripts/bench-registration.sh

setup: ## install what demo and test want from Debian, where that is allowed
	@scripts/setup.sh all
