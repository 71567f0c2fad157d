//! Irradiance volumes: light at the points of a grid in the scene, as ambient cubes that engines look up for what
//! moves.

use glam::{UVec3, Vec3};
use gpugi_scene::image::HalfTexture;
use gpugi_scene::{Bounds, Camera, Scene};
use half::f16;

use crate::capture::{Output, Probe, Receiver, Slots, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, read_buffer};
use crate::lighting::{Budget, Lighting, LightingError, Readiness};
use crate::techniques::Registry;

/// Most voxels, and most of them along an axis, so that a 3D texture of the layout below holds them.
const MOST_VOXELS: u64 = 1 << 18;
const MOST_ALONG: [u32; 3] = [2048, 1024, 682];

/// Normals of an ambient cube's sides.
const SIDES: [Vec3; 6] = [
    Vec3::X,
    Vec3::NEG_X,
    Vec3::Y,
    Vec3::NEG_Y,
    Vec3::Z,
    Vec3::NEG_Z,
];

/// Ambient cubes in a grid of voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct IrradianceVolume {
    /// Voxels along each axis.
    pub counts: UVec3,
    /// What the voxels fill together (m).
    pub bounds: Bounds,
    /// Per voxel, x first, then y, then z: irradiance over pi in its middle, of surfaces that face +X, -X, +Y, -Y, +Z
    /// and -Z. That is the radiance of a white Lambert surface there (W/sr/m^2).
    pub cubes: Vec<[Vec3; 6]>,
}

impl IrradianceVolume {
    /// What the technique `adds`, among those of `names`, adds at the middles of voxels that fill the scene's bounds,
    /// `density` per metre. `settings`: technique, name and value each.
    ///
    /// # Errors
    /// [`LightingError`]; [`GpuError::Input`] for an empty scene, [`GpuError::TooLarge`] for too many voxels.
    pub fn bake(
        gpu: &Gpu,
        scene: &Scene,
        names: &[String],
        settings: &[[&str; 3]],
        adds: &str,
        density: f32,
    ) -> Result<Self, LightingError> {
        let registry = Registry::default();
        let mut on_gpu = Lighting::upload(gpu, scene, names, &registry)?;
        let mut lighting = Lighting::new(gpu, &mut on_gpu, names, &registry)?;
        for [technique, name, value] in settings {
            lighting.set(&mut on_gpu, technique, name, value)?;
        }
        lighting.light_elsewhere();
        let bounds = on_gpu.bounds;
        let counts = counts(gpu, &bounds, density)?;
        let probes: Vec<Probe> = middles(&bounds, counts)
            .flat_map(|position| {
                SIDES.map(|direction| Probe {
                    position,
                    direction,
                })
            })
            .collect();
        let count = probes.len() as u32;
        let target = Target::new(gpu, count)?;
        let slots = Slots::default();
        let receiver = Receiver::of_probes(gpu, &probes, Output::Irradiance, &target, slots)?;
        let diagonal = on_gpu.diagonal();
        let camera = Camera::look_at("", bounds.center(), bounds.center() + Vec3::NEG_Z, 1.0);
        let index = View::NO_SAMPLE;
        let view = View::new(&camera, [1, 1], glam::Vec2::ZERO, index, 0, diagonal);
        loop {
            let mut frame = Frame::new(gpu, false);
            let readiness = lighting.prepare(&mut frame, &mut on_gpu, &view, Budget::UNLIMITED)?;
            let is_ready = readiness == Readiness::Ready;
            if is_ready {
                let is_wanted = |name: &str| name == adds;
                lighting.gather_some(&mut frame, &on_gpu, &receiver, is_wanted)?;
            }
            frame.submit()?;
            if is_ready {
                break;
            }
            gpu.wait()?;
            on_gpu.wait_for_atlas();
        }
        let light: Vec<[f32; 4]> = read_buffer(gpu, &target.radiance, u64::from(count) * 16)?;
        let side = |[red, green, blue, _]: [f32; 4]| {
            Vec3::new(red, green, blue) * std::f32::consts::FRAC_1_PI
        };
        let cubes = light.chunks_exact(6);
        Ok(Self {
            counts,
            bounds,
            cubes: cubes
                .map(|cube| std::array::from_fn(|index| side(cube[index])))
                .collect(),
        })
    }

    /// A 3D texture of Rx x 2 Ry x 3 Rz texels, as Bevy reads irradiance volumes: the slices of x, of y and of z above
    /// each other along the third axis; in each, sides that face along the axis in the first half of the second axis,
    /// and those that face against it in the other.
    pub fn texture(&self) -> HalfTexture {
        let UVec3 { x, y, z } = self.counts;
        let texel = |at: UVec3| {
            let axis = at.z / z;
            let is_negative = at.y / y;
            let voxel = at.x + x * (at.y % y + y * (at.z % z));
            let side = self.cubes[voxel as usize][(2 * axis + is_negative) as usize];
            let [red, green, blue] = side.to_array().map(f16::from_f32);
            [red, green, blue, f16::ONE]
        };
        let rows = (0..3 * z).flat_map(|z| (0..2 * y).map(move |y| (y, z)));
        let texels = rows.flat_map(|(y, z)| (0..x).map(move |x| UVec3::new(x, y, z)));
        HalfTexture {
            size: [x, 2 * y],
            depth: 3 * z,
            faces: 1,
            levels: vec![texels.map(texel).collect()],
        }
    }
}

/// Voxels along each axis.
fn counts(gpu: &Gpu, bounds: &Bounds, density: f32) -> Result<UVec3, GpuError> {
    let extent = bounds.max - bounds.min;
    if !extent.is_finite() || extent.min_element() < 0.0 {
        return Err(GpuError::Input {
            what: "an empty scene has no irradiance volume".into(),
        });
    }
    let counts = (extent * density).ceil().max(Vec3::ONE);
    let counts = counts.min(Vec3::splat(1e6)).as_uvec3();
    let all = counts.to_array().map(u64::from).iter().product();
    let along = counts.to_array().into_iter().zip(MOST_ALONG);
    let is_too_long = along.clone().any(|(count, most)| count > most);
    if all > MOST_VOXELS || is_too_long {
        return Err(GpuError::TooLarge {
            what: "voxels of an irradiance volume (ask for fewer per metre)".into(),
            needed: all,
            limit: MOST_VOXELS,
            adapter: gpu.adapter.name.clone(),
        });
    }
    Ok(counts)
}

/// The middles of voxels (m), x first, then y, then z.
fn middles(bounds: &Bounds, counts: UVec3) -> impl Iterator<Item = Vec3> {
    let (low, extent) = (bounds.min, bounds.max - bounds.min);
    let rows = (0..counts.z).flat_map(move |z| (0..counts.y).map(move |y| (y, z)));
    let all = rows.flat_map(move |(y, z)| (0..counts.x).map(move |x| UVec3::new(x, y, z)));
    all.map(move |at| low + extent * (at.as_vec3() + 0.5) / counts.as_vec3())
}
