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
mod textures;

pub use renewal::{Renew, Renewal};
pub use textures::{cube_texture, cubes, layers_of_cube, layers_of_level};

use std::mem;
use std::sync::Arc;

use glam::{Quat, Vec3};
use wgpu::BindingResource::TextureView;

use crate::capture::distance_pyramid::{DistancePyramid, PyramidKernels};
use crate::capture::{Capture, CaptureKernels, CubeView, Faces, PeeledLayer, SurfacePoints};
use crate::gpu::{Bind, Frame, Gpu, GpuError, Kernel, Named};
use crate::scene::{Draw, DrawClass, GpuScene};
use crate::shader;
use renewal::{Begun, Due, RenewalKey};
use shape::{ShapePasses, Shaped};
use textures::{cube, layers};

/// Which maps a technique requests.
#[derive(Debug, Clone, PartialEq)]
pub struct ImpostorRequest {
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

impl ImpostorRequest {
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
    /// The points that this frame captured or leaves to be relit: all faces, those of one turn, or none.
    pub renewed: Option<SurfacePoints>,
    /// Counts renewals, so that users notice those of frames in which they did not follow.
    pub renewals: u64,
    /// The points that are to be renewed, by [`Impostors::renew`]. Until then they show what they were captured of.
    pub due: Option<SurfacePoints>,
    /// Pixels that [`Impostors::renew`] would draw.
    pub due_pixels: u64,
    /// The second layer behind `points`; where nothing lies behind them, it repeats them.
    pub peeled: Option<Arc<PeeledLayer>>,
    /// Distances of the points (m), layer after layer.
    pub distances: wgpu::Texture,
    /// Outward normals, if the object is a refractor.
    pub normals: Option<wgpu::Texture>,
    shape: wgpu::Texture,
    shape_normals: wgpu::Texture,
    /// Distances and the pyramid with which they are searched, the same of the shape, and its normals.
    views: [wgpu::TextureView; 5],
}

impl Maps {
    /// What passes that import maps.wesl and refractor.wesl bind.
    pub fn resources<'a>(
        &'a self,
        of_object: &'a dyn Bind,
        sampler: &'a wgpu::Sampler,
    ) -> [Named<'a>; 7] {
        let [distances, pyramid, shape, shape_pyramid, normals] = &self.views;
        [
            ("of_object", of_object),
            ("map_sampler", sampler),
            ("distances_unfilterable", distances),
            ("pyramid_unfilterable", pyramid),
            ("shape_unfilterable", shape),
            ("shape_pyramid_unfilterable", shape_pyramid),
            ("shape_normals", normals),
        ]
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

/// The maps of all objects for which techniques request them.
#[derive(Debug)]
pub struct Impostors {
    capture: CaptureKernels,
    store_surroundings: Kernel,
    pyramids: PyramidKernels,
    shapes: ShapePasses,
    kept: Vec<ObjectMaps>,
    frame: u64,
}

#[derive(Debug)]
struct ObjectMaps {
    wanted: ImpostorRequest,
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
    /// The renewal that is due.
    planned: Option<Planned>,
    turns: Vec<FaceGroup>,
    shaped: Option<Shaped>,
    is_shape_due: bool,
    /// The frame of the latest request.
    asked: Option<u64>,
}

/// A renewal that is due, and the state of the scene that it would show.
#[derive(Debug, Clone, Copy)]
struct Planned {
    due: Due,
    begun: Begun,
    of: RenewalKey,
}

/// Faces that are renewed together.
#[derive(Debug)]
struct FaceGroup {
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
            pyramids: PyramidKernels::new(gpu)?,
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
        let last = |maps: &ObjectMaps| maps.asked.unwrap_or(now);
        self.kept.retain(|maps| now - last(maps) <= Self::PATIENCE);
    }

    /// The maps `wanted`, which follow the object as far as that needs no capture, with what [`ImpostorRequest::renewal`] finds
    /// due. `settings_version` as in [`crate::techniques::Earlier`]; `seed` seeds everything stochastic in cubes.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn follow(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        wanted: &ImpostorRequest,
        settings_version: u64,
        seed: u32,
    ) -> Result<&Maps, GpuError> {
        let index = match self.kept.iter().position(|maps| maps.wanted == *wanted) {
            Some(index) => index,
            None => {
                self.kept.push(self.make(gpu, scene, wanted.clone())?);
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
        kept.plan(scene, now, self.frame);
        Ok(&kept.maps)
    }

    /// The maps `wanted`, renewed as far as [`Impostors::follow`] finds them due, at most once per frame; and the number
    /// of pixels that were drawn.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn renew(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        wanted: &ImpostorRequest,
        settings_version: u64,
        seed: u32,
    ) -> Result<(&Maps, u64), GpuError> {
        self.follow(frame.gpu, scene, wanted, settings_version, seed)?;
        let mut kept = self.kept.iter_mut();
        let kept = kept.find(|maps| maps.wanted == *wanted);
        let kept = kept.expect("maps that were just requested");
        if mem::take(&mut kept.is_shape_due) {
            kept.capture_shape(frame, scene, &mut self.shapes)?;
        }
        if let Some(planned) = kept.planned.take() {
            kept.renew(frame, scene, &self.store_surroundings, planned)?;
        }
        kept.maps.due = None;
        let pixels = mem::take(&mut kept.maps.due_pixels);
        Ok((&kept.maps, pixels))
    }

    fn make(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        wanted: ImpostorRequest,
    ) -> Result<ObjectMaps, GpuError> {
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
        let pyramid = DistancePyramid::new(gpu, &self.pyramids, &surroundings)?;
        let shape_pyramid = DistancePyramid::new(gpu, &self.pyramids, &shape)?;
        let shape_normals = normals(shape_side)?;
        let capture = Capture::of_cube(gpu, &self.capture, wanted.side)?;
        let turns = (0..wanted.renewal.turns()).map(|turn| {
            let faces = capture.faces(gpu, wanted.renewal.faces_of(turn))?;
            Ok(FaceGroup {
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
                renewals: 0,
                due: None,
                due_pixels: 0,
                distances: surroundings.clone(),
                normals: wanted.shape_side.is_some().then(|| shape_normals.clone()),
                views: [
                    layers(&surroundings),
                    layers(&pyramid.texture),
                    layers(&shape),
                    layers(&shape_pyramid.texture),
                    cube(&shape_normals),
                ],
                shape,
                shape_normals,
            },
            wanted,
            capture,
            pyramid,
            shape_pyramid,
            begun: None,
            planned: None,
            turns,
            shaped: None,
            is_shape_due: false,
            asked: None,
        })
    }
}

impl ObjectMaps {
    /// Follows the object, and finds what is due in frame `number`.
    fn plan(&mut self, scene: &GpuScene, now: RenewalKey, number: u64) {
        (self.planned, self.is_shape_due) = (None, false);
        let wanted = &self.wanted;
        if !wanted.renewal.is_settled(self.begun.as_ref(), &now)
            && let Some(center) = wanted.center(scene).or(wanted.reference)
        {
            self.maps.center = center;
            let due = wanted.renewal.due(
                self.begun.as_ref(),
                now,
                number,
                (&wanted.instances, center),
                &scene.placements,
                wanted.reference.is_some(),
            );
            self.planned = due.map(|(due, begun)| Planned {
                due,
                begun,
                of: now,
            });
            if wanted.shape_side.is_some() {
                self.follow_shape(scene);
            }
        }
        let of_face = |side: u32| u64::from(side) * u64::from(side);
        let (due, faces) = match self.planned.map(|planned| planned.due) {
            None => (None, 0),
            Some(Due::All) => (Some(self.maps.points.clone()), 6),
            Some(Due::FaceGroup(index)) => {
                let points = self.maps.turns[index].clone();
                let faces = self.wanted.renewal.faces_of(index).len() as u64;
                (
                    Some(points),
                    if self.shows(index, &now, scene) {
                        0
                    } else {
                        faces
                    },
                )
            }
        };
        let shape = self.wanted.shape_side.filter(|_| self.is_shape_due);
        let of_layer = faces * of_face(self.wanted.side);
        self.maps.due = due;
        self.maps.due_pixels =
            of_layer * u64::from(self.wanted.layers) + shape.map_or(0, |side| 6 * of_face(side));
    }

    /// Whether the faces of a turn already show what a capture at `now` would.
    fn shows(&self, turn: usize, now: &RenewalKey, scene: &GpuScene) -> bool {
        let captured = self.turns[turn].captured;
        captured.is_some_and(|it| it.shows(now, &self.wanted.instances, &scene.placements))
    }

    /// Captures the surroundings as planned.
    fn renew(
        &mut self,
        frame: &mut Frame<'_>,
        scene: &GpuScene,
        store: &Kernel,
        Planned { due, begun, of }: Planned,
    ) -> Result<(), GpuError> {
        match due {
            Due::All => {
                self.maps.reference = self.wanted.reference.unwrap_or(self.maps.center);
                let faces = self.capture.all_faces();
                self.capture_faces(frame, scene, store, &faces, of.seed)?;
                for turn in &mut self.turns {
                    turn.captured = Some(of);
                }
                self.maps.renewed = Some(faces.points);
            }
            Due::FaceGroup(index) => {
                let faces = self.turns[index].faces.clone();
                if !self.shows(index, &of, scene) {
                    self.capture_faces(frame, scene, store, &faces, of.seed)?;
                    self.turns[index].captured = Some(of);
                }
                self.maps.renewed = Some(faces.points);
            }
        }
        self.begun = Some(begun);
        self.maps.renewals += 1;
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
        let view = CubeView::new(self.maps.reference, side, scene.near(), 0, seed);
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
