//! The whole router, asked without a socket: one server for each table of requests.

mod findings;
mod immutable;
mod layers;
mod preferences;
mod queries;
mod readings;
mod refusals;
mod registration;
mod report;
mod server;
mod share;
mod slices;
mod uploads;
mod versions;
