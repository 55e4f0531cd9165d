//! The program `isocortex`.
fn main(){}
