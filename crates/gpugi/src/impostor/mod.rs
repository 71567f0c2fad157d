//! The maps around objects in which distance impostors and caustics trace rays: how far an object's surroundings are in
//! every direction from a reference point, and, where light passes through the object, its own shape seen from its
//! centre (tutorial sections 5.1 and 5.3).
//!
//! Techniques that request the same maps share them; each adds what only it needs, such as the maps' radiance.

pub(crate) mod gpu;
mod renewal;
mod shape;
#[cfg(test)]
mod tests;

pub use renewal::{Renew, Renewal};

use std::sync::Arc;

use glam::{Quat, Vec3};
use wgpu::BindingResource::{Sampler, TextureView};

use crate::capture::distance_pyramid::DistancePyramid;
use crate::capture::{Capture, CaptureKernels, CubeView, Faces, PeeledLayer, SurfacePoints};
use crate::gpu::{Frame, Gpu, GpuError, Kernel};
use crate::scene::{Draw, DrawClass, GpuScene};
use crate::shader;
use renewal::{Begun, Due, RenewalKey};
use shape::{ShapePasses, Shaped};

/// Near distance of cubes, as a fraction of the scene's diagonal.
const NEAR: f32 = 1e-4;

/// Which maps a technique requests.
#[derive(Debug, Clone, PartialEq)]
pub struct Wanted {
    /// Indices of the instances that the maps surround and leave out, ascending: the parts of one object, or objects near
    /// each other; none for what is seen from a reference point in the open.
    pub instances: Arc<[u32]>,
    /// Side of the faces of the surroundings' cube (texels), a power of two.
    pub side: u32,
    /// The same for the cube of the object's own shape, if light passes through the object.
    pub shape_side: Option<u32>,
    /// Where the cube is captured from (m); `None`: from the centre of the instances.
    pub reference: Option<Vec3>,
    /// Layers: 1, or 2 to also capture what the reference point would see if the nearest surfaces were not there.
    pub layers: u32,
    /// When the maps are renewed.
    pub renewal: Renewal,
}

impl Wanted {
    /// Whether the draw is one of the instances that the maps surround.
    fn is_own(&self, draw: &Draw) -> bool {
        self.instances.binary_search(&draw.instance).is_ok()
    }

    /// The mean of the instances' centres, weighted by their sizes (m); `None` if none is drawn. It moves and turns with
    /// instances that move and turn together.
    fn center(&self, scene: &GpuScene) -> Option<Vec3> {
        let mut sum = (Vec3::ZERO, 0.0);
        for draw in scene.draws.iter().filter(|draw| self.is_own(draw)) {
            let world_from_mesh = scene.placements[draw.instance as usize].world_from_mesh;
            let bounds = &draw.mesh_bounds;
            let size = world_from_mesh.transform_vector3(bounds.max - bounds.min);
            let weight = size.length().max(f32::MIN_POSITIVE);
            let center = world_from_mesh.transform_point3(bounds.center());
            sum = (sum.0 + weight * center, sum.1 + weight);
        }
        (sum.1 > 0.0).then(|| sum.0 / sum.1)
    }
}

/// The maps of one object.
#[derive(Debug, Clone)]
pub struct Maps {
    /// Where the surroundings were captured from (m).
    pub reference: Vec3,
    /// The object's centre (m).
    pub center: Vec3,
    /// Rotation of the object since its shape was captured.
    pub world_from_shape: Quat,
    /// What the reference point sees: six faces, stacked vertically.
    pub points: SurfacePoints,
    /// The same points by turn: each entry has the faces that are renewed together.
    pub turns: Vec<SurfacePoints>,
    /// The points to relight in this frame: all faces, those of one turn, or none.
    pub renewed: Option<SurfacePoints>,
    /// The second layer behind `points`; where nothing lies behind them, it repeats them.
    pub peeled: Option<Arc<PeeledLayer>>,
    /// Distances of the points (m), layer after layer.
    pub distances: wgpu::Texture,
    /// Outward normals, if the object is a refractor.
    pub normals: Option<wgpu::Texture>,
    surroundings: DistanceCube,
    shape: DistanceCube,
    shape_normals: wgpu::Texture,
}

/// Distances, and the pyramid with which they are searched.
#[derive(Debug, Clone)]
struct DistanceCube {
    distances: wgpu::Texture,
    pyramid: wgpu::Texture,
}

impl Maps {
    /// Bind group 2 of a pass: the bindings of maps.wesl and refractor.wesl, and `more`.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn bind(
        &self,
        gpu: &Gpu,
        kernel: &Kernel,
        of_object: &wgpu::Buffer,
        sampler: &wgpu::Sampler,
        more: &[(&str, wgpu::BindingResource<'_>)],
    ) -> Result<wgpu::BindGroup, GpuError> {
        let [distances, shape] =
            [&self.surroundings, &self.shape].map(|one| layers(&one.distances));
        let [pyramid, shape_pyramid] =
            [&self.surroundings, &self.shape].map(|one| layers(&one.pyramid));
        let normals = cube(&self.shape_normals);
        let mut resources = vec![
            ("of_object", of_object.as_entire_binding()),
            ("map_sampler", Sampler(sampler)),
            ("distances_unfilterable", TextureView(&distances)),
            ("pyramid_unfilterable", TextureView(&pyramid)),
            ("shape_unfilterable", TextureView(&shape)),
            ("shape_pyramid_unfilterable", TextureView(&shape_pyramid)),
            ("shape_normals", TextureView(&normals)),
        ];
        resources.extend_from_slice(more);
        kernel.bind(gpu, 2, &resources)
    }

    /// The points to light for some of [`Maps::points`]: those points, and the second layer behind them.
    pub fn layers(&self, points: &SurfacePoints) -> Vec<SurfacePoints> {
        let peeled = self.peeled.iter().map(|peeled| peeled.points(points));
        [points.clone()].into_iter().chain(peeled).collect()
    }

    /// Whether `other` has the same textures.
    pub fn is_same(&self, other: &Self) -> bool {
        self.distances == other.distances
    }
}

/// A texture of `cubes` cube maps, with six layers per cube map.
///
/// # Errors
/// [`GpuError::TooLarge`], [`GpuError::OutOfMemory`].
pub fn cube_texture(
    gpu: &Gpu,
    label: &str,
    format: wgpu::TextureFormat,
    side: u32,
    levels: u32,
    cubes: u32,
) -> Result<wgpu::Texture, GpuError> {
    gpu.texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: 6 * cubes,
        },
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// All levels of a texture's layers.
fn layers(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// The layers of one level.
pub fn layers_of_level(texture: &wgpu::Texture, level: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        base_mip_level: level,
        mip_level_count: Some(1),
        ..Default::default()
    })
}

/// The six layers of cube map `cube`, at the finest level.
pub fn layers_of_cube(texture: &wgpu::Texture, cube: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        mip_level_count: Some(1),
        base_array_layer: 6 * cube,
        array_layer_count: Some(6),
        ..Default::default()
    })
}

/// The layers as one cube map.
fn cube(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::Cube),
        ..Default::default()
    })
}

/// The layers as cube maps.
pub fn cubes(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::CubeArray),
        ..Default::default()
    })
}

/// The maps of all objects for which techniques request them.
#[derive(Debug)]
pub struct Impostors {
    capture: CaptureKernels,
    store_surroundings: Kernel,
    shapes: ShapePasses,
    kept: Vec<ObjectMaps>,
    frame: u64,
}

#[derive(Debug)]
struct ObjectMaps {
    wanted: Wanted,
    maps: Maps,
    capture: Capture,
    pyramid: DistancePyramid,
    shape_pyramid: DistancePyramid,
    /// Bind group 3 of each layer's `impostor.store` pass.
    stored: Vec<wgpu::BindGroup>,
    /// Bind group 1 of the same passes, for points that were stored before.
    stored_points: Vec<(SurfacePoints, wgpu::BindGroup)>,
    /// Bind group 3 of the shape's pass.
    stored_shape: Option<wgpu::BindGroup>,
    begun: Option<Begun>,
    turns: Vec<Turn>,
    shaped: Option<Shaped>,
    /// The frame of the latest request.
    asked: Option<u64>,
}

/// Faces that are renewed together.
#[derive(Debug)]
struct Turn {
    faces: Faces,
    captured: Option<RenewalKey>,
}

impl Impostors {
    /// Maps unrequested for this many frames are dropped: otherwise dragging a setting would leave old maps behind in
    /// every frame.
    const PATIENCE: u64 = 2;

    /// Compiles the passes.
    ///
    /// # Errors
    /// [`GpuError::Pass`].
    pub fn new(gpu: &Gpu, scene: &GpuScene, capture: &CaptureKernels) -> Result<Self, GpuError> {
        let store = shader!("impostor.store");
        let layout = Some(&scene.layout);
        Ok(Self {
            capture: capture.clone(),
            store_surroundings: Kernel::new(gpu, &store, "surroundings", layout)?,
            shapes: ShapePasses::new(gpu, scene, capture)?,
            kept: Vec::new(),
            frame: 0,
        })
    }

    /// The pipelines of captures.
    pub fn capture_kernels(&self) -> &CaptureKernels {
        &self.capture
    }

    /// Begins a frame, and drops maps that are no longer requested.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
        self.shapes.begin_frame();
        let now = self.frame;
        let last = |one: &ObjectMaps| one.asked.unwrap_or(now);
        self.kept.retain(|one| now - last(one) <= Self::PATIENCE);
    }

    /// The maps `wanted`, updated as [`Wanted::renewal`] says, at most once per frame. `settings_version` as in
    /// [`crate::techniques::Earlier`]; `seed` seeds everything stochastic in cubes.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn of(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        wanted: &Wanted,
        settings_version: u64,
        seed: u32,
    ) -> Result<&Maps, GpuError> {
        let index = match self.kept.iter().position(|one| one.wanted == *wanted) {
            Some(index) => index,
            None => {
                self.kept.push(self.make(frame.gpu, scene, wanted.clone())?);
                self.kept.len() - 1
            }
        };
        let kept = &mut self.kept[index];
        if kept.asked == Some(self.frame) {
            return Ok(&kept.maps);
        }
        kept.asked = Some(self.frame);
        kept.maps.renewed = None;
        let now = RenewalKey {
            versions: scene.versions,
            settings: settings_version,
            seed,
        };
        if !wanted.renewal.is_settled(kept.begun.as_ref(), &now)
            && let Some(center) = wanted.center(scene).or(wanted.reference)
        {
            kept.maps.center = center;
            if wanted.shape_side.is_some() {
                kept.follow_shape(frame, scene, &mut self.shapes)?;
            }
            kept.renew(frame, scene, &self.store_surroundings, now, self.frame)?;
        }
        Ok(&kept.maps)
    }

    fn make(&self, gpu: &Gpu, scene: &GpuScene, wanted: Wanted) -> Result<ObjectMaps, GpuError> {
        let distances = |side, cubes| {
            let format = wgpu::TextureFormat::R32Float;
            cube_texture(gpu, "impostor.distances", format, side, 1, cubes)
        };
        let normals = |side| {
            let format = wgpu::TextureFormat::Rgba16Float;
            cube_texture(gpu, "impostor.normals", format, side, 1, 1)
        };
        // A shader needs all of its textures bound, even those that it does not read.
        let least = crate::capture::distance_pyramid::LEAST_SIDE;
        let shape_side = wanted.shape_side.unwrap_or(least);
        let [surroundings, shape] = [
            distances(wanted.side, wanted.layers)?,
            distances(shape_side, 1)?,
        ];
        let pyramid = DistancePyramid::new(gpu, &surroundings)?;
        let shape_pyramid = DistancePyramid::new(gpu, &shape)?;
        let shape_normals = normals(shape_side)?;
        let capture = Capture::of_cube(gpu, &self.capture, wanted.side)?;
        let turns = (0..wanted.renewal.turns()).map(|turn| {
            let faces = capture.faces(gpu, wanted.renewal.faces_of(turn))?;
            Ok(Turn {
                faces,
                captured: None,
            })
        });
        let turns = turns.collect::<Result<Vec<_>, GpuError>>()?;
        let unread = layers(&normals(least)?);
        let stored = (0..wanted.layers).map(|layer| {
            let resources = [
                (
                    "distances",
                    TextureView(&layers_of_cube(&surroundings, layer)),
                ),
                ("normals", TextureView(&unread)),
            ];
            self.store_surroundings.bind(gpu, 3, &resources)
        });
        let stored = stored.collect::<Result<_, GpuError>>()?;
        let peeled = if wanted.layers > 1 {
            Some(Arc::new(PeeledLayer::new(gpu, scene, &capture)?))
        } else {
            None
        };
        Ok(ObjectMaps {
            stored,
            stored_points: Vec::new(),
            stored_shape: None,
            maps: Maps {
                reference: Vec3::ZERO,
                center: Vec3::ZERO,
                world_from_shape: Quat::IDENTITY,
                points: capture.points.clone(),
                peeled,
                turns: turns.iter().map(|turn| turn.faces.points.clone()).collect(),
                renewed: None,
                distances: surroundings.clone(),
                normals: wanted.shape_side.is_some().then(|| shape_normals.clone()),
                surroundings: DistanceCube {
                    distances: surroundings,
                    pyramid: pyramid.texture.clone(),
                },
                shape: DistanceCube {
                    distances: shape,
                    pyramid: shape_pyramid.texture.clone(),
                },
                shape_normals,
            },
            wanted,
            capture,
            pyramid,
            shape_pyramid,
            begun: None,
            turns,
            shaped: None,
            asked: None,
        })
    }
}

impl ObjectMaps {
    /// Captures the surroundings again, as far as that is due.
    fn renew(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        store: &Kernel,
        now: RenewalKey,
        number: u64,
    ) -> Result<(), GpuError> {
        let Wanted {
            ref instances,
            reference,
            renewal,
            ..
        } = self.wanted;
        let center = self.maps.center;
        let due = renewal.due(
            self.begun.as_ref(),
            now,
            number,
            (instances, center),
            &scene.placements,
            reference.is_some(),
        );
        let Some((due, begun)) = due else {
            return Ok(());
        };
        match due {
            Due::All => {
                self.maps.reference = reference.unwrap_or(center);
                let faces = self.capture.all_faces();
                self.capture_faces(frame, scene, store, &faces, now.seed)?;
                for turn in &mut self.turns {
                    turn.captured = Some(now);
                }
                self.maps.renewed = Some(faces.points);
            }
            Due::Turn(index) => {
                let turn = &self.turns[index];
                let faces = turn.faces.clone();
                let captured = turn.captured;
                if !captured.is_some_and(|it| it.shows(&now, instances, &scene.placements)) {
                    self.capture_faces(frame, scene, store, &faces, now.seed)?;
                    self.turns[index].captured = Some(now);
                }
                self.maps.renewed = Some(faces.points);
            }
        }
        self.begun = Some(begun);
        Ok(())
    }

    fn capture_faces(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        store: &Kernel,
        faces: &Faces,
        seed: u32,
    ) -> Result<(), GpuError> {
        let (gpu, wanted, side) = (frame.gpu, &self.wanted, self.wanted.side);
        let view = CubeView::new(self.maps.reference, side, near(scene), 0, seed);
        // From now on all turns look from here, including those that only relight what was captured before.
        for turn in &self.turns {
            turn.faces.look(gpu, &view.uniform);
        }
        let class_of = |draw: &Draw| (!wanted.is_own(draw)).then_some(seen_from_outside(draw));
        self.capture
            .record_faces(frame, scene, &view, faces, class_of)?;
        if let Some(peeled) = &self.maps.peeled {
            let reference = self.maps.reference;
            peeled.record(frame, scene, &self.capture, &view, faces, |draw| {
                (!wanted.is_own(draw)).then_some(seen_peeled(draw, reference))
            })?;
        }
        let bound = &mut self.stored_points;
        for (points, stored) in self.maps.layers(&faces.points).iter().zip(&self.stored) {
            let points = match bound.iter().position(|(of, _)| of.is_same(points)) {
                Some(known) => &bound[known].1,
                None => {
                    bound.push((points.clone(), points.bind(gpu, store)?));
                    &bound[bound.len() - 1].1
                }
            };
            frame.compute("impostor.store", |pass| {
                let groups = [(0, &scene.bind_group), (1, points), (3, stored)];
                store.dispatch(pass, &groups, [side, side, faces.count()]);
            });
        }
        self.pyramid.record(frame);
        Ok(())
    }
}

/// Near distance of cubes (m).
fn near(scene: &GpuScene) -> f32 {
    scene.diagonal() * NEAR
}

/// How a cube draws an object: other glass only from outside, because the reference point may lie inside it.
fn seen_from_outside(draw: &Draw) -> DrawClass {
    if draw.seen != draw.class && draw.seen == DrawClass::DoubleSided {
        DrawClass::Open
    } else {
        draw.seen
    }
}

/// How the second layer draws an object. A closed object's own back does not count as behind it, unless the reference
/// point lies within its bounds.
fn seen_peeled(draw: &Draw, reference: Vec3) -> DrawClass {
    let bounds = &draw.bounds;
    let is_inside = reference.cmpge(bounds.min).all() && reference.cmple(bounds.max).all();
    match seen_from_outside(draw) {
        DrawClass::DoubleSided if draw.is_closed && !is_inside => DrawClass::Closed,
        DrawClass::AlphaDoubleSided if draw.is_closed && !is_inside => DrawClass::Alpha,
        class => class,
    }
}
