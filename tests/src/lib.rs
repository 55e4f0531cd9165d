//! Integration tests of Isocortex; everything is in the one test program `it`. Here is what `fuzz/` shares with it.

pub mod fuzzed;
