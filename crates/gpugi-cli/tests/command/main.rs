//! Tests of the command as a user runs it: one program, so that it links once.

mod bake;
#[cfg(unix)]
mod bake_stops;
mod bake_surfaces;
mod common;
mod compare;
mod convert;
mod far_from_origin;
mod film;
mod measure;
mod path_tracer;
mod usage;
