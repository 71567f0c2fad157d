//! Reads surface points back.

use glam::Vec3;

use crate::capture::SurfacePoints;
use crate::gpu::{Frame, Gpu, Kernel, read_buffer};
use crate::scene::GpuScene;
use crate::shader;

/// An unpacked surface point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    pub position: Vec3,
    /// `u32::MAX` if there is no point.
    pub instance: u32,
    pub normal: Vec3,
    pub area: f32,
    pub geometric_normal: Vec3,
    pub diffuse: Vec3,
}

/// All points, in order.
pub(crate) fn read_points(gpu: &Gpu, scene: &GpuScene, points: &SurfacePoints) -> Vec<Point> {
    let kernel = Kernel::new(gpu, &shader!("testing.points"), "main", Some(&scene.layout)).unwrap();
    let size = u64::from(points.count) * 64;
    let storage = wgpu::BufferUsages::STORAGE;
    let output = gpu.buffer("output", size, storage).unwrap();
    let resources = [
        ("points", points.points.as_entire_binding()),
        ("output", output.as_entire_binding()),
    ];
    let group = kernel.bind(gpu, 1, &resources).unwrap();
    let mut frame = Frame::new(gpu, false);
    frame.compute("points", |pass| {
        let groups = [(0, &scene.bind_group), (1, &group)];
        kernel.dispatch(pass, &groups, [points.count, 1, 1]);
    });
    frame.submit().unwrap();
    let rows: Vec<[[u32; 4]; 4]> = read_buffer(gpu, &output, size).unwrap();
    let vector = |[x, y, z, _]: [u32; 4]| Vec3::from_array([x, y, z].map(f32::from_bits));
    rows.iter()
        .map(|rows| Point {
            position: vector(rows[0]),
            instance: rows[0][3],
            normal: vector(rows[1]),
            area: f32::from_bits(rows[1][3]),
            geometric_normal: vector(rows[2]),
            diffuse: vector(rows[3]),
        })
        .collect()
}
