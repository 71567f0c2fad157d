//! Shared test support: the adapter, and tiny kernels (the `.wesl` files of this folder) that run one function on a
//! buffer.

pub(crate) mod chi_square;
mod layouts;
mod points;
mod rooms;
#[path = "../../tests/common/time.rs"]
mod time;

pub(crate) use points::{Point, read_points};

use std::sync::OnceLock;

use crate::gpu::{AdapterChoice, Frame, Gpu, GpuError, Kernel, Shader, read_buffer};
use crate::techniques::{Generated, Unready};

/// The adapter that tests run on: the one named by `GPUGI_TEST_ADAPTER`, otherwise the best. All tests of the process
/// share one device. `None`, in which case the test should return, only if `GPUGI_SKIP_GPU=1`, or without time.
///
/// # Panics
/// If there is no adapter.
pub(crate) fn test_gpu() -> Option<Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    if !time::there_is_time() {
        return None;
    }
    GPU.get_or_init(open).clone()
}

/// As [`test_gpu`], for one test alone: nobody else uploads to it.
///
/// # Panics
/// If there is no adapter.
pub(crate) fn own_test_gpu() -> Option<Gpu> {
    time::there_is_time().then(open).flatten()
}

fn open() -> Option<Gpu> {
    if std::env::var("GPUGI_SKIP_GPU").is_ok_and(|value| value == "1") {
        return None;
    }
    let choice = match std::env::var("GPUGI_TEST_ADAPTER") {
        Ok(name) => name.parse().unwrap_or_default(),
        Err(_) => AdapterChoice::Best,
    };
    let gpu = Gpu::open(&choice);
    Some(
        gpu.expect(
            "tests need a GPU adapter, a software one will do (GPUGI_SKIP_GPU=1 skips them)",
        ),
    )
}

/// The state of a technique's maps, also while it waits for something else.
pub(crate) fn settled(generated: Result<Generated, Unready>) -> Result<Generated, GpuError> {
    match generated {
        Ok(generated) => Ok(generated),
        Err(Unready::Waits { progress, what }) => Ok(Generated {
            revision: 0,
            progress,
            pending: Some(what),
        }),
        Err(Unready::Failed(error)) => Err(error),
    }
}

/// Runs a kernel whose group 0 holds the buffers `inputs` by name and `output`, and returns the output's `count` items.
///
/// # Errors
/// The error that the GPU reports.
pub(crate) fn run_kernel<T: bytemuck::Pod>(
    gpu: &Gpu,
    shader: &Shader,
    entry: &str,
    inputs: &[(&str, &wgpu::Buffer)],
    count: usize,
    invocations: u32,
) -> Result<Vec<T>, GpuError> {
    let inputs: Vec<_> = inputs
        .iter()
        .map(|(name, buffer)| (*name, buffer.as_entire_binding()))
        .collect();
    run_kernel_on(gpu, shader, entry, &inputs, count, invocations)
}

/// Like [`run_kernel`], with inputs of any kind.
///
/// # Errors
/// The error that the GPU reports.
pub(crate) fn run_kernel_on<T: bytemuck::Pod>(
    gpu: &Gpu,
    shader: &Shader,
    entry: &str,
    inputs: &[(&str, wgpu::BindingResource<'_>)],
    count: usize,
    invocations: u32,
) -> Result<Vec<T>, GpuError> {
    let kernel = Kernel::new(gpu, shader, entry, None)?;
    let size = (count * std::mem::size_of::<T>()) as u64;
    let output = gpu.buffer("output", size, wgpu::BufferUsages::STORAGE)?;
    let mut resources = inputs.to_vec();
    resources.push(("output", output.as_entire_binding()));
    let group = kernel.bind(gpu, 0, &resources)?;
    let mut frame = Frame::new(gpu, false);
    frame.compute(shader.name, |pass| {
        kernel.dispatch(pass, &[(0, &group)], [invocations, 1, 1]);
    });
    frame.submit()?;
    read_buffer(gpu, &output, size)
}

/// The value of a `u32` constant that a shader imports from a module, whose path is written with underscores.
pub(crate) fn constant(shader: &Shader, module_path: &str, name: &str) -> u32 {
    let module = shader.parse().unwrap();
    let mut constants = module.constants.iter();
    let found = constants.find(|(_, constant)| {
        let linked = constant.name.as_deref().unwrap_or_default();
        linked.contains(module_path) && linked.ends_with(name)
    });
    let (_, found) = found.unwrap_or_else(|| panic!("{} has no constant {name}", shader.name));
    match module.global_expressions[found.init] {
        naga::Expression::Literal(naga::Literal::U32(value)) => value,
        ref other => panic!("{name}: {other:?}"),
    }
}

/// The point at (u, v) of a face of the cube of half side length 1. This is WebGPU's definition, with which
/// shared/cube.wesl must agree.
pub(crate) fn on_face(face: usize, u: f64, v: f64) -> glam::DVec3 {
    let [x, y, z] = [
        [1.0, -v, -u],
        [-1.0, -v, u],
        [u, 1.0, v],
        [u, -1.0, -v],
        [u, -v, 1.0],
        [-u, -v, -1.0],
    ][face];
    glam::DVec3::new(x, y, z)
}

/// Random numbers in [0, 1) that are the same on every machine: SplitMix64.
pub(crate) struct Random(pub u64);

impl Random {
    /// The next number in [0, 1).
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A unit vector, uniformly distributed over the sphere.
    pub fn direction(&mut self) -> glam::Vec3 {
        let z = 2.0 * self.next() - 1.0;
        let phi = std::f64::consts::TAU * self.next();
        let r = (1.0 - z * z).sqrt();
        glam::DVec3::new(r * phi.cos(), r * phi.sin(), z).as_vec3()
    }
}
