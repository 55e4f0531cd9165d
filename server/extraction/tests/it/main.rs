//! Extraction as a whole: on phantoms always, with the network where its weights are, on real heads where these are.
//!
//! The weights are looked for where `ISOCORTEX_NETWORK` says, else where the set-up puts them; the heads where
//! `ISOCORTEX_TEST_DATA` says. What is missing is said on standard error, and its tests are skipped.

mod cuts;
mod heads;
mod network;
mod pruning;
mod spoiled;
mod support;
mod unseen;
mod verdicts;
mod wrong_heads;
