//! The shaders without a device, and with one if there is one.

mod conformance;
mod drawing;
mod faults;
mod shaders;
mod shrink;
mod support;
