//! Tests of the WESL functions in this folder, run by the kernels of `testing/`.

mod bc6h_tests;
mod brdf_tests;
pub(crate) mod cpu;
mod cube_tests;
mod hammersley_tests;
mod impostor_cpu;
mod impostor_tests;
mod octahedral_tests;
mod phase_tests;
mod sampling_tests;
mod sobol_tests;
