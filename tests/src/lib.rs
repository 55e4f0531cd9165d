//! Integration tests of Isocortex; everything is in the one test program `it`.
