# All commands for people and the continuous integration; `make help` lists them. The scripts in scripts/ do the work and can also
# be run alone.

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup web demo test check faults lab bench bench-record bench-times bench-peers bench-registration sbom dist dist-test

help: ## list these commands
	@awk 'BEGIN { FS = ":.*## " } /^[a-z-]+:.*## / { printf "  make %-18s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

web: ## bundle the page into web/dist, which the program embeds
	@scripts/web.sh

demo: ## build, prepare a real head and serve the page at a printed address
	@scripts/demo.sh

test: ## install what is missing, then check format and lints and run all tests, also in a browser
	@scripts/setup.sh test
	@scripts/test.sh all

check: ## check format and lints and run the fast tests; installs nothing
	@scripts/test.sh fast

faults: ## attack the program with everything in tests/faults/ and report broken expectations
	@scripts/faults.sh

sbom: ## write the list of the crates that the program is made of, as CycloneDX JSON, into target/
	@scripts/sbom.py

dist: ## make everything that is released, in target/dist/: archive, Debian package, wheel, list of crates, checksums
	@scripts/dist.sh

dist-test: ## install, start, upgrade and remove what `make dist` made; needs root
	@scripts/dist-test.sh

lab: ## check, build and test the laboratory: the paper, the study, comparisons with other programs
	@lab/scripts/test.sh

bench: ## count the instructions of every hot step and compare with the recorded base (times, if valgrind is missing)
	@scripts/bench.sh

bench-record: ## record the counted instructions as the base
	@scripts/bench.sh record

bench-times: ## measure the time of every hot step
	@scripts/bench.sh times

bench-peers: ## measure other programs on the same head, in alternation with ours
	@lab/scripts/peers.sh

bench-registration: ## measure the error of registrations of synthetic pairs, ours and SimpleITK's
	@lab/scripts/registration.sh

setup: ## install the Debian packages for demo and test, if allowed
	@scripts/setup.sh all
