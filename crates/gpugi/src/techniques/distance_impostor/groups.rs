//! Which objects share a cube (tutorial section 5.5: "a single cube map for all of them, or a separate map for each").

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use crate::scene::{DELTA_ROUGHNESS, GpuScene, Object};

/// Objects that share a cube.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Indices of the instances, ascending.
    pub members: Arc<[u32]>,
    pub kind: Kind,
    /// What the cube leaves out, so that surroundings are seen from inside the objects; ascending.
    pub left_out: Arc<[u32]>,
    /// The least roughness of a member.
    roughness: f32,
}

/// What cubes hold, and which maps they have beside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Light passes through the object: a map of its shape.
    Refractor,
    /// Mirrors: emitters and the sky are in the cube.
    Mirror,
    /// Rough surfaces: other techniques add light straight from emitters and the sky.
    Rough,
    /// Rough surfaces that are surroundings themselves, such as floors: the cube shows everything from the eye.
    Surroundings,
}

/// Coarsest cube of rough surfaces: a texel is a fortieth of the distance from the cube's centre.
const LEAST_SIDE: f32 = 64.0;
/// Texels per side of a face, times alpha, the tangent of a lobe's half-angle: three texels across it.
const TEXELS_PER_LOBE: f32 = 3.0;
/// Rough objects are surroundings from this share of the scene's diagonal on.
const LEAST_SURROUNDINGS: f32 = 0.5;
/// Mirrors share cubes only if they are this much nearer to each other than rough surfaces: there, it shows.
const MIRROR_SPREAD: f32 = 8.0;

impl Kind {
    /// Whether the cube holds light straight from emitters and the sky.
    pub fn is_smooth(self) -> bool {
        matches!(self, Self::Refractor | Self::Mirror)
    }

    fn of(object: &Object) -> Self {
        match object {
            _ if !object.is_smooth => Self::Rough,
            _ if object.is_transmissive && object.is_solid => Self::Refractor,
            _ => Self::Mirror,
        }
    }
}

impl Group {
    /// Side of the faces of the group's cube, at most `resolution` (texels).
    pub fn side(&self, resolution: u32) -> u32 {
        if self.kind != Kind::Rough {
            return resolution;
        }
        let alpha = (self.roughness * self.roughness).max(1e-4);
        let side = (TEXELS_PER_LOBE / alpha).clamp(LEAST_SIDE, 1024.0);
        (side as u32).next_power_of_two().min(resolution)
    }

    /// Whether a member may be ideal somewhere.
    pub fn has_ideal_lobes(&self) -> bool {
        self.roughness < DELTA_ROUGHNESS
    }

    fn new(units: &[Unit], scene: &GpuScene) -> Self {
        let mut members: Vec<u32> = units
            .iter()
            .flat_map(|unit| &unit.members)
            .copied()
            .collect();
        members.sort_unstable();
        let roughness = members
            .iter()
            .map(|&member| scene.objects[member as usize].least_roughness);
        let roughness = roughness.fold(1.0, f32::min);
        let kind = units[0].kind;
        let mut left_out = match kind {
            Kind::Surroundings => Vec::new(),
            _ => members.clone(),
        };
        if matches!(kind, Kind::Mirror | Kind::Rough) {
            left_out.extend(units.iter().flat_map(|unit| &unit.inside));
            left_out.sort_unstable();
            left_out.dedup();
        }
        Self {
            left_out: left_out.into(),
            members: members.into(),
            kind,
            roughness,
        }
    }
}

/// The instances of one object: of a node with several materials, those of one kind.
#[derive(Debug, Clone)]
struct Unit {
    members: Vec<u32>,
    kind: Kind,
    /// Other parts of its node inside its box, such as the seats of a car whose body mirrors: seen from the middle, they
    /// would hide what the outside reflects.
    inside: Vec<u32>,
    /// Centre and diagonal of its box (m).
    center: Vec3,
    size: f32,
}

/// Divides the instances `claimed` into at most `most` groups, three or more. Each refractor has its own, the largest
/// first; those beyond remain without. All others have one: large rough surfaces together, and what is near each other.
pub fn groups(claimed: &[u32], scene: &GpuScene, most: usize) -> Vec<Group> {
    let units = units(claimed, scene);
    let of_kind = |kind| -> Vec<Unit> {
        let units = units.iter().filter(|unit| unit.kind == kind);
        units.cloned().collect()
    };
    let mut refractors = of_kind(Kind::Refractor);
    refractors.sort_by(|a, b| b.size.total_cmp(&a.size));
    let mut shared = [Kind::Mirror, Kind::Rough, Kind::Surroundings]
        .map(of_kind)
        .to_vec();
    shared.retain(|units| !units.is_empty());
    // What shares cubes gets half of them if it needs as many, and one per kind in any case.
    let sharing: usize = shared.iter().map(Vec::len).sum();
    refractors.truncate(most - sharing.min(most / 2).max(shared.len().min(most)));
    // The most spread group is split until all are single objects or there are as many as may be.
    while shared.len() + refractors.len() < most {
        let spreads = shared.iter().map(|units| spread(units)).enumerate();
        let Some((widest, _)) = spreads
            .filter(|(_, spread)| *spread >= 0.0)
            .max_by(|a, b| a.1.total_cmp(&b.1))
        else {
            break;
        };
        let units = shared.swap_remove(widest);
        shared.extend(halves(units));
    }
    let mut groups: Vec<Group> = refractors
        .chunks(1)
        .chain(shared.iter().map(Vec::as_slice))
        .map(|units| Group::new(units, scene))
        // Nothing but lights is left to see.
        .filter(|group| group.kind != Kind::Rough || group.members.len() < scene.draws.len())
        .collect();
    groups.sort_by(|a, b| a.members.cmp(&b.members));
    groups
}

fn units(claimed: &[u32], scene: &GpuScene) -> Vec<Unit> {
    let mut boxes = vec![None; scene.objects.len()];
    for draw in &scene.draws {
        boxes[draw.instance as usize] = Some(draw.bounds);
    }
    let key = |index: u32| {
        let object = &scene.objects[index as usize];
        (
            object.part_of.is_none().then_some(index),
            object.part_of,
            Kind::of(object),
        )
    };
    let mut parts = BTreeMap::<_, Vec<u32>>::new();
    for (index, object) in (0..).zip(&scene.objects) {
        if let Some(node) = object.part_of {
            parts.entry(node).or_default().push(index);
        }
    }
    let mut sorted = claimed.to_vec();
    sorted.sort_by_key(|&index| (key(index), index));
    let units = sorted.chunk_by(|&a, &b| key(a) == key(b)).map(|members| {
        let of_members = members
            .iter()
            .filter_map(|&member| boxes[member as usize].as_ref());
        let (low, high) = of_members.fold(
            (Vec3::INFINITY, Vec3::NEG_INFINITY),
            |(low, high), bounds| (low.min(bounds.min), high.max(bounds.max)),
        );
        let size = (high - low).length();
        let kind = Kind::of(&scene.objects[members[0] as usize]);
        let node = scene.objects[members[0] as usize].part_of;
        let others = node.and_then(|node| parts.get(&node)).into_iter().flatten();
        let is_inside = |part: &&u32| {
            let own = boxes[**part as usize].as_ref();
            own.is_some_and(|own| own.min.cmpge(low).all() && own.max.cmple(high).all())
        };
        let is_large = kind == Kind::Rough && size >= LEAST_SURROUNDINGS * scene.diagonal();
        Unit {
            members: members.to_vec(),
            kind: if is_large { Kind::Surroundings } else { kind },
            inside: others.filter(is_inside).copied().collect(),
            center: (low + high) / 2.0,
            size,
        }
    });
    // What is not drawn has no place.
    units.filter(|unit| unit.center.is_finite()).collect()
}

/// Lowest and highest centre.
fn corners(units: &[Unit]) -> (Vec3, Vec3) {
    let ends = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    units.iter().fold(ends, |(low, high), unit| {
        (low.min(unit.center), high.max(unit.center))
    })
}

/// How much the units need cubes of their own; negative if they do not.
fn spread(units: &[Unit]) -> f32 {
    if units.len() < 2 || units[0].kind == Kind::Surroundings {
        return -1.0;
    }
    let (low, high) = corners(units);
    let weight = if units[0].kind == Kind::Mirror {
        MIRROR_SPREAD
    } else {
        1.0
    };
    weight * (high - low).length()
}

/// Splits units, two or more, at the median along the axis in which their centres are spread most.
fn halves(mut units: Vec<Unit>) -> [Vec<Unit>; 2] {
    let (low, high) = corners(&units);
    let extent = high - low;
    let axis = extent.max_position();
    units.sort_by(|a, b| a.center[axis].total_cmp(&b.center[axis]));
    let far = units.split_off(units.len() / 2);
    [units, far]
}
