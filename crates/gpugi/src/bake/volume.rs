//! Irradiance volumes: light at the points of a grid in the scene, as ambient cubes or spherical harmonics that engines
//! look up for what moves.

use std::f32::consts::{FRAC_1_PI, PI};
use std::marker::PhantomData;

use glam::{DVec3, UVec3, Vec3};
use gpugi_scene::image::HalfTexture;
use gpugi_scene::{Bounds, Camera, Scene};
use half::f16;
use serde::{Deserialize, Serialize};

use super::solver::Solver;
use super::tasks::{
    Bake, BakeKey, Part, Progress, Shares, Stage, Task, TaskResult, digest, result_of, unfit,
};
use crate::capture::{Output, Probe, Receiver, Slots, Target, View};
use crate::gpu::{Frame, Gpu, GpuError, read_buffer};
use crate::lighting::{Lighting, LightingError};
use crate::techniques::Registry;
use crate::techniques::environment_map::export::{BASIS, COSINE_FACTORS, IRRADIANCE};

/// Most voxels, and most of them along an axis, so that 3D textures of the layouts below hold them.
const MOST_VOXELS: u64 = 1 << 18;
const MOST_ALONG: [u32; 3] = [2048, 682, 682];
/// Most points that are lit together.
const MOST_POINTS: u32 = 1 << 20;

/// Normals of an ambient cube's sides.
const SIDES: [Vec3; 6] = [
    Vec3::X,
    Vec3::NEG_X,
    Vec3::Y,
    Vec3::NEG_Y,
    Vec3::Z,
    Vec3::NEG_Z,
];

/// Which light a volume holds: what the technique `adds` adds, among those of `names`.
#[derive(Debug, Clone, Copy)]
pub struct VolumeLight<'a> {
    /// The techniques in use.
    pub names: &'a [String],
    /// Technique, name and value each.
    pub settings: &'a [[&'a str; 3]],
    /// The technique whose light the volume holds.
    pub adds: &'a str,
}

/// Light in a grid of voxels, baked by a [`VolumeBake`].
pub trait Volume: Sized {
    /// The normals of surfaces whose irradiance each voxel needs (unit vectors).
    fn normals() -> Vec<Vec3>;

    /// The volume of `counts` voxels along each axis, which fill the box between two corners together (m, in the file's
    /// coordinates). `irradiance` (W/m^2): per voxel, x first, then y, then z, that of surfaces in its middle with those
    /// normals.
    fn new(counts: UVec3, bounds: [DVec3; 2], irradiance: &[Vec3]) -> Self;

    /// The light at the middles of voxels that fill the scene's bounds, `density` per metre.
    ///
    /// # Errors
    /// Those of [`VolumeBake::new`].
    fn bake(
        gpu: &Gpu,
        scene: &Scene,
        light: &VolumeLight<'_>,
        density: f32,
    ) -> Result<Self, LightingError> {
        let mut bake = VolumeBake::new(gpu, scene, light, density, MOST_POINTS)?;
        while bake.step()?.is_some() {}
        Ok(bake.finish())
    }
}

/// Ambient cubes in a grid of voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct IrradianceVolume {
    /// Voxels along each axis.
    pub counts: UVec3,
    /// Corners of what the voxels fill together, in the file's coordinates (m).
    pub bounds: [DVec3; 2],
    /// Per voxel, x first, then y, then z: irradiance over pi in its middle, of surfaces that face +X, -X, +Y, -Y, +Z
    /// and -Z. That is the radiance of a white Lambert surface there (W/sr/m^2).
    pub cubes: Vec<[Vec3; 6]>,
}

impl Volume for IrradianceVolume {
    fn normals() -> Vec<Vec3> {
        SIDES.to_vec()
    }

    fn new(counts: UVec3, bounds: [DVec3; 2], irradiance: &[Vec3]) -> Self {
        let cubes = irradiance.chunks_exact(6);
        Self {
            counts,
            bounds,
            cubes: cubes
                .map(|cube| std::array::from_fn(|side| cube[side] * FRAC_1_PI))
                .collect(),
        }
    }
}

impl IrradianceVolume {
    /// A 3D texture of Rx x 2 Ry x 3 Rz texels, as Bevy reads irradiance volumes: the slices of x, of y and of z above
    /// each other along the third axis; in each, sides that face along the axis in the first half of the second axis,
    /// and those that face against it in the other.
    pub fn texture(&self) -> HalfTexture {
        blocks(self.counts, [2, 3], |voxel, [is_negative, axis]| {
            self.cubes[voxel][(2 * axis + is_negative) as usize]
        })
    }
}

/// Spherical harmonics of bands 0 to 2 in a grid of voxels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HarmonicVolume {
    /// Voxels along each axis.
    pub counts: UVec3,
    /// Corners of what the voxels fill together, in the file's coordinates (m).
    pub bounds: [DVec3; 2],
    /// The functions Y_i of the unit direction (x, y, z) in the scene's axes.
    pub basis: [String; 9],
    /// Factors by which the clamped cosine multiplies the coefficients.
    pub cosine_factors: [f32; 9],
    /// The formula for irradiance.
    pub irradiance: String,
    /// Per voxel, x first, then y, then z: L_i = integral of L Y_i over the sphere, red, green and blue (W/m^2). They
    /// are those of the incident radiance, before the convolution with the clamped cosine.
    pub radiance_coefficients: Vec<[Vec3; 9]>,
}

impl Volume for HarmonicVolume {
    /// 26 directions, whose irradiance holds all that a diffuse surface can tell of the light.
    fn normals() -> Vec<Vec3> {
        lebedev().map(|(direction, _)| direction).to_vec()
    }

    fn new(counts: UVec3, bounds: [DVec3; 2], irradiance: &[Vec3]) -> Self {
        let nodes = lebedev();
        let voxels = irradiance.chunks_exact(nodes.len());
        Self {
            counts,
            bounds,
            basis: BASIS.map(str::to_owned),
            cosine_factors: COSINE_FACTORS,
            irradiance: IRRADIANCE.to_owned(),
            radiance_coefficients: voxels
                .map(|irradiance| {
                    let mut sums = [Vec3::ZERO; 9];
                    for ((direction, weight), irradiance) in nodes.iter().zip(irradiance) {
                        for (sum, y) in sums.iter_mut().zip(basis(*direction)) {
                            *sum += *irradiance * (y * weight);
                        }
                    }
                    std::array::from_fn(|i| sums[i] / COSINE_FACTORS[i])
                })
                .collect(),
        }
    }
}

impl HarmonicVolume {
    /// Irradiance of a surface in a voxel that faces `normal` (W/m^2).
    pub fn irradiance_at(&self, voxel: usize, normal: Vec3) -> Vec3 {
        let terms = basis(normal).into_iter().zip(self.cosine_factors);
        let terms = terms.zip(self.radiance_coefficients[voxel]);
        terms.map(|((y, factor), light)| light * (y * factor)).sum()
    }

    /// A 3D texture of Rx x 3 Ry x 3 Rz texels: coefficient i of all voxels lies in block i % 3 along the second axis
    /// and i / 3 along the third.
    pub fn texture(&self) -> HalfTexture {
        blocks(self.counts, [3, 3], |voxel, [column, layer]| {
            self.radiance_coefficients[voxel][(column + 3 * layer) as usize]
        })
    }
}

/// A 3D texture of voxels, in blocks along the second and the third axis; `light`: of a voxel in a block.
fn blocks(
    counts: UVec3,
    [columns, layers]: [u32; 2],
    light: impl Fn(usize, [u32; 2]) -> Vec3,
) -> HalfTexture {
    let UVec3 { x, y, z } = counts;
    let texel = |at: UVec3| {
        let voxel = at.x + x * (at.y % y + y * (at.z % z));
        let light = light(voxel as usize, [at.y / y, at.z / z]);
        let [red, green, blue] = light.to_array().map(f16::from_f32);
        [red, green, blue, f16::ONE]
    };
    let rows = (0..layers * z).flat_map(|z| (0..columns * y).map(move |y| (y, z)));
    let texels = rows.flat_map(|(y, z)| (0..x).map(move |x| UVec3::new(x, y, z)));
    HalfTexture {
        size: [x, columns * y],
        depth: layers * z,
        faces: 1,
        levels: vec![texels.map(texel).collect()],
    }
}

/// Y_i of a unit direction, as in shared/spherical_harmonics.wesl.
fn basis(d: Vec3) -> [f32; 9] {
    [
        0.282_094_8,
        0.488_602_5 * d.y,
        0.488_602_5 * d.z,
        0.488_602_5 * d.x,
        1.092_548_4 * d.x * d.y,
        1.092_548_4 * d.y * d.z,
        0.315_391_57 * (3.0 * d.z * d.z - 1.0),
        1.092_548_4 * d.x * d.z,
        0.546_274_2 * (d.x * d.x - d.y * d.y),
    ]
}

/// Lebedev's quadrature over the sphere with 26 unit directions, exact for polynomials of degree 7, and its weights
/// (sr).
fn lebedev() -> [(Vec3, f32); 26] {
    let all = (0..27).map(|i| Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) - 1.0);
    let nodes = all.filter(|direction| *direction != Vec3::ZERO);
    let mut nodes = nodes.map(|direction| {
        // Towards faces, edges and corners of a cube.
        let weight =
            [1.0 / 21.0, 4.0 / 105.0, 9.0 / 280.0][direction.length_squared() as usize - 1];
        (direction.normalize(), 4.0 * PI * weight)
    });
    std::array::from_fn(|_| nodes.next().expect("27 less the middle"))
}

/// Bakes the light of a volume, one tile of voxels per task. A tile has one sample.
#[derive(Debug)]
pub struct VolumeBake<V> {
    solver: Solver,
    /// The technique whose light the volume holds.
    adds: String,
    key: BakeKey,
    counts: UVec3,
    bounds: Bounds,
    /// Corners of the bounds in the file's coordinates (m).
    bounds_in_file: [DVec3; 2],
    normals: Vec<Vec3>,
    voxels_per_task: usize,
    /// Irradiance in the finished tiles.
    done: Vec<Option<Vec<Vec3>>>,
    volume: PhantomData<V>,
}

/// Irradiance in the voxels of one tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VoxelPart {
    /// Index of the tile.
    pub(super) tile: u32,
    /// (W/m^2)
    pub(super) irradiance: Vec<Vec3>,
}

impl<V: Volume> VolumeBake<V> {
    /// A bake at the middles of voxels that fill the scene's bounds, `density` per metre, in tasks of up to
    /// `voxels_per_task`.
    ///
    /// # Errors
    /// [`LightingError`]; [`GpuError::Input`] for an empty scene and a density that is not positive,
    /// [`GpuError::TooLarge`] for too many voxels.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        light: &VolumeLight<'_>,
        density: f32,
        voxels_per_task: u32,
    ) -> Result<Self, LightingError> {
        if !(density.is_finite() && density > 0.0) {
            return Err(input(format!(
                "an irradiance volume needs a positive density, not {density} per metre"
            ))
            .into());
        }
        let registry = Registry::default();
        let mut on_gpu = Lighting::upload(gpu, scene, light.names, &registry)?;
        let bounds = on_gpu.bounds;
        let counts = counts(gpu, &bounds, density)?;
        let lighting = Lighting::new(gpu, &mut on_gpu, light.names, &registry)?;
        let camera = Camera::look_at("", bounds.center(), bounds.center() + Vec3::NEG_Z, 1.0);
        let (index, diagonal) = (View::NO_SAMPLE, on_gpu.diagonal());
        let view = View::new(&camera, [1, 1], glam::Vec2::ZERO, index, 0, diagonal);
        let mut solver = Solver::new(gpu, on_gpu, lighting, view);
        for [technique, name, value] in light.settings {
            solver.set(technique, name, value)?;
        }
        let normals = V::normals();
        let most = MOST_POINTS / normals.len() as u32;
        let voxels_per_task = voxels_per_task.clamp(1, most) as usize;
        let how = (
            ("volume", &normals, counts, voxels_per_task),
            (solver.techniques(), light.adds),
        );
        let tiles = (counts.element_product() as usize).div_ceil(voxels_per_task);
        Ok(Self {
            key: BakeKey::new(gpu, &digest(scene, &()), &how),
            solver,
            adds: light.adds.to_owned(),
            counts,
            bounds,
            bounds_in_file: [bounds.min, bounds.max].map(|corner| scene.in_file(corner)),
            normals,
            voxels_per_task,
            done: vec![None; tiles],
            volume: PhantomData,
        })
    }

    fn shares(&self) -> Shares {
        Shares {
            tiles: self.done.len() as u32,
            samples: 1,
            samples_per_task: 1,
        }
    }

    /// The points of a tile.
    fn probes(&self, tile: u32) -> Vec<Probe> {
        let middles = middles(&self.bounds, self.counts);
        let of_tile = middles.skip(tile as usize * self.voxels_per_task);
        let of_tile = of_tile.take(self.voxels_per_task);
        let probes = of_tile.flat_map(|position| {
            let normals = self.normals.iter();
            normals.map(move |&direction| Probe {
                position,
                direction,
            })
        });
        probes.collect()
    }

    /// Irradiance at the points of a tile. Waits for the GPU.
    fn light(&mut self, tile: u32) -> Result<VoxelPart, LightingError> {
        let probes = self.probes(tile);
        let Solver {
            gpu,
            on_gpu,
            lighting,
            ..
        } = &mut self.solver;
        let count = probes.len() as u32;
        let target = Target::new(gpu, count)?;
        let slots = Slots::default();
        let receiver = Receiver::of_probes(gpu, &probes, Output::Irradiance, &target, slots)?;
        let mut frame = Frame::new(gpu, false);
        let adds = |name: &str| name == self.adds;
        lighting.gather_some(&mut frame, on_gpu, &receiver, adds)?;
        frame.submit()?;
        let light: Vec<[f32; 4]> = read_buffer(gpu, &target.radiance, u64::from(count) * 16)?;
        let irradiance = light.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b));
        Ok(VoxelPart {
            tile,
            irradiance: irradiance.collect(),
        })
    }

    /// The volume; tiles that were never lit are black.
    pub fn finish(self) -> V {
        let per_tile = self.voxels_per_task * self.normals.len();
        let mut irradiance = Vec::new();
        for tile in self.done {
            irradiance.extend(tile.unwrap_or_else(|| vec![Vec3::ZERO; per_tile]));
        }
        irradiance.truncate(self.counts.element_product() as usize * self.normals.len());
        V::new(self.counts, self.bounds_in_file, &irradiance)
    }
}

impl<V: Volume> Bake for VolumeBake<V> {
    type Samples = VoxelPart;

    fn tasks(&self) -> Vec<Task> {
        let tiles = self.shares().tasks();
        [Task::Maps].into_iter().chain(tiles).collect()
    }

    fn step(&mut self) -> Result<Option<Progress>, LightingError> {
        if self.solver.is_refining {
            let progress = self.solver.refine()?;
            return Ok(Some(progress));
        }
        let Some(tile) = self.done.iter().position(Option::is_none) else {
            return Ok(None);
        };
        let part = self.light(tile as u32)?;
        self.done[tile] = Some(part.irradiance);
        let done = self.done.iter().flatten().count();
        Ok(Some(Progress {
            stage: Stage::Samples,
            done: done as f32 / self.done.len() as f32,
        }))
    }

    fn run(&mut self, task: &Task) -> Result<Part<VoxelPart>, LightingError> {
        if let Task::Samples { tile, samples } = task {
            self.shares().find(*tile, samples)?;
        }
        self.solver.solve()?;
        let result = match task {
            Task::Maps => TaskResult::Maps(self.solver.save()?),
            Task::Samples { tile, .. } => TaskResult::Samples(self.light(*tile)?),
        };
        Ok(Part {
            bake: self.key,
            result,
        })
    }

    fn merge(&mut self, part: Part<VoxelPart>) -> Result<(), LightingError> {
        match result_of(part, self.key)? {
            TaskResult::Maps(maps) => {
                if self.solver.is_refining {
                    self.solver.saved = maps;
                }
            }
            TaskResult::Samples(VoxelPart { tile, irradiance }) => {
                self.shares().find(tile, &(0..1))?;
                let is_finite = irradiance.iter().all(|value| value.is_finite());
                if irradiance.len() != self.probes(tile).len() || !is_finite {
                    return Err(unfit("the result of a task of another bake"));
                }
                self.done[tile as usize].get_or_insert(irradiance);
            }
        }
        Ok(())
    }

    fn is_complete(&self) -> bool {
        self.done.iter().all(Option::is_some)
    }
}

fn input(what: String) -> GpuError {
    GpuError::Input { what }
}

/// Voxels along each axis.
fn counts(gpu: &Gpu, bounds: &Bounds, density: f32) -> Result<UVec3, GpuError> {
    let extent = bounds.max - bounds.min;
    if !extent.is_finite() || extent.min_element() < 0.0 {
        return Err(input("an empty scene has no irradiance volume".into()));
    }
    let counts = (extent * density).ceil().max(Vec3::ONE);
    let counts = counts.min(Vec3::splat(1e6)).as_uvec3();
    let all = counts.to_array().map(u64::from).iter().product();
    let along = ["x", "y", "z"]
        .into_iter()
        .zip(counts.to_array().into_iter().zip(MOST_ALONG));
    let along = along.map(|(axis, (count, most))| {
        (
            format!("voxels of an irradiance volume along {axis}"),
            count.into(),
            most.into(),
        )
    });
    let limits = along.chain([("voxels of an irradiance volume".into(), all, MOST_VOXELS)]);
    let too_many = limits.into_iter().find(|(_, needed, limit)| needed > limit);
    match too_many {
        Some((what, needed, limit)) => Err(GpuError::TooLarge {
            what: format!("{what} (ask for fewer per metre)"),
            needed,
            limit,
            adapter: gpu.adapter.name.clone(),
        }),
        None => Ok(counts),
    }
}

/// The middles of voxels (m), x first, then y, then z.
fn middles(bounds: &Bounds, counts: UVec3) -> impl Iterator<Item = Vec3> {
    let (low, extent) = (bounds.min, bounds.max - bounds.min);
    let rows = (0..counts.z).flat_map(move |z| (0..counts.y).map(move |y| (y, z)));
    let all = rows.flat_map(move |(y, z)| (0..counts.x).map(move |x| UVec3::new(x, y, z)));
    all.map(move |at| low + extent * (at.as_vec3() + 0.5) / counts.as_vec3())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A volume that is too long along one axis says so, and by how much.
    #[test]
    fn too_many_voxels_are_refused() {
        let Some(gpu) = crate::testing::test_gpu() else {
            return;
        };
        let refused = |extent: Vec3| {
            let bounds = Bounds {
                min: Vec3::ZERO,
                max: extent,
            };
            match counts(&gpu, &bounds, 1.0) {
                Err(GpuError::TooLarge { needed, limit, .. }) => Some((needed, limit)),
                _ => None,
            }
        };
        assert_eq!(refused(Vec3::new(3000.0, 1.0, 1.0)), Some((3000, 2048)));
        assert_eq!(refused(Vec3::new(1.0, 1.0, 700.0)), Some((700, 682)));
        assert_eq!(refused(Vec3::splat(100.0)), Some((1_000_000, MOST_VOXELS)));
        assert_eq!(refused(Vec3::splat(64.0)), None);
    }

    /// The quadrature finds that the harmonics are orthonormal, and powers have their means over the sphere.
    #[test]
    fn harmonics_are_orthonormal() {
        let nodes = lebedev();
        for i in 0..9 {
            for j in 0..9 {
                let products = nodes.map(|(d, weight)| weight * basis(d)[i] * basis(d)[j]);
                let expected = f32::from(u8::from(i == j));
                let found = products.iter().sum::<f32>();
                assert!((found - expected).abs() < 1e-5, "{i} {j}: {found}");
            }
        }
        let mean = nodes
            .iter()
            .map(|(d, weight)| weight * d.x.powi(6))
            .sum::<f32>();
        assert!((mean - 4.0 * PI / 7.0).abs() < 1e-5, "{mean}");
    }
}
