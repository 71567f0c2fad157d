//! Scenes far from the origin of their file.
//!
//! GPUs compute in 32 bits, whose steps grow with the distance from the origin: a millimetre at 10 km, 3 cm at 500 km,
//! as in map coordinates. So importers, which compute in 64 bits, move such a scene to the origin ([`Scene::origin`]),
//! and such a mesh to that of its node ([`Mesh::origin`]).

use glam::{DMat4, DVec3, Vec3};

use crate::animation::{Pose, Rig};
use crate::{Bounds, Mesh, Scene};

/// What lies nearer to the origin stays there (m).
const NEAR: f64 = 1000.0;
/// So does what is larger than this part of its distance: little would be gained.
const LARGE: f64 = 0.25;
/// Steps of coordinates are worth a warning from this part of the size of what they place.
const COARSE: f64 = 1e-4;

/// Smallest and largest corner of a box (m).
pub(crate) type Corners = [DVec3; 2];

/// Where the origin should lie for a scene that consists of `boxes`: in the middle of most of them, in whole metres, if
/// that is far away; otherwise zero. Medians keep a few stray objects from deciding.
pub(crate) fn origin_of(boxes: impl IntoIterator<Item = Corners>) -> DVec3 {
    let corners: Vec<DVec3> = boxes.into_iter().flatten().collect();
    let [x, y, z] = [0, 1, 2].map(|axis| median(corners.iter().map(|corner| corner[axis])));
    let middle = DVec3::new(x, y, z);
    let size = median(corners.iter().map(|corner| corner.distance(middle)));
    let distance = middle.length();
    if distance.is_finite() && distance > NEAR && size < LARGE * distance {
        middle.round()
    } else {
        DVec3::ZERO
    }
}

/// The mean of the two values in the middle; NaN without values.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    let is_even = values.len().is_multiple_of(2);
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = if is_even {
        below.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    } else {
        upper
    };
    lower.midpoint(upper)
}

/// The box around `points`; None without points.
pub(crate) fn corners_of(points: impl IntoIterator<Item = DVec3>) -> Option<Corners> {
    let joined = |[min, max]: Corners, [low, high]: Corners| [min.min(low), max.max(high)];
    let points = points.into_iter().map(|point| [point, point]);
    points.reduce(joined)
}

/// `points` in 32 bits, from an origin near them if they lie far away.
pub(crate) fn near(points: &[DVec3]) -> Vec<Vec3> {
    let first = points.first().filter(|point| point.length() > NEAR);
    let origin = first.map_or(DVec3::ZERO, |point| point.round());
    points
        .iter()
        .map(|&point| (point - origin).as_vec3())
        .collect()
}

/// The step of 32-bit coordinates in a box (m), if it is coarse for what the box holds.
pub(crate) fn coarse_step([min, max]: Corners) -> Option<f64> {
    let largest = min.abs().max(max.abs()).max_element() as f32;
    let step = f64::from(largest.next_up() - largest);
    (step > COARSE * (max - min).length() && f64::from(largest) > NEAR).then_some(step)
}

impl Mesh {
    /// The step of positions in 32 bits where the mesh lies (m), if it is coarse for the mesh.
    pub(crate) fn step_of_positions(&self) -> Option<f64> {
        let positions = self.positions.iter().map(|position| position.as_dvec3());
        corners_of(positions).and_then(coarse_step)
    }

    /// Moves a mesh that lies far from its origin to it.
    pub(crate) fn recentre(&mut self) {
        let positions = self.positions.iter().map(|position| position.as_dvec3());
        self.origin = origin_of(corners_of(positions));
        if self.origin != DVec3::ZERO {
            for position in &mut self.positions {
                *position = (position.as_dvec3() - self.origin).as_vec3();
            }
        }
    }
}

impl Scene {
    /// Places everything in a scene that was just imported, at the origin if it lies far away, and warns of what still
    /// lies far from it. `rig`: of the nodes that carry instances, lights, cameras and media.
    pub(crate) fn settle(&mut self, rig: &Rig) {
        self.origin = origin_of(self.corners_in_file(rig, &rig.pose(0.0)));
        for edit in self.posed_by(rig, 0.0) {
            edit.apply_to(self);
        }
    }

    /// The boxes of instances and media in the file's coordinates. Skinned meshes are where their joints are.
    fn corners_in_file(&self, rig: &Rig, pose: &Pose) -> Vec<Corners> {
        let meshes: Vec<Bounds> = self.meshes.iter().map(|mesh| mesh.bounds()).collect();
        let placed = |bounds: Bounds, file_from_space: DMat4| {
            let corners = bounds.corners().map(Vec3::as_dvec3);
            corners_of(corners.map(|corner| file_from_space.transform_point3(corner)))
        };
        let skins = rig.deformers.iter().filter_map(|deformer| {
            let (skin, _) = deformer.skin.as_ref()?;
            Some((deformer.instance, &rig.skins[*skin].joints))
        });
        let skins: std::collections::HashMap<_, _> = skins.collect();
        let instances = self
            .instances
            .iter()
            .enumerate()
            .filter_map(|(index, instance)| {
                if let Some(joints) = skins.get(&index) {
                    let joints = joints.iter().map(|&joint| pose.file_from_node[joint]);
                    return corners_of(joints.map(|joint| joint.w_axis.truncate()));
                }
                let node_from_mesh = DMat4::from_translation(self.meshes[instance.mesh].origin);
                placed(
                    meshes[instance.mesh],
                    pose.file_from_node[instance.node?] * node_from_mesh,
                )
            });
        let unit = Bounds {
            min: Vec3::splat(-0.5),
            max: Vec3::splat(0.5),
        };
        let media = self
            .media
            .iter()
            .filter(|medium| medium.world_from_box.is_some());
        let media = media.filter_map(|medium| placed(unit, pose.file_from_node[medium.node?]));
        instances.chain(media).collect()
    }

    /// Warns of objects that lie so far from the origin that 32-bit coordinates there are coarse for them.
    pub(crate) fn warn_of_far_objects(&mut self) {
        let meshes: Vec<Bounds> = self.meshes.iter().map(|mesh| mesh.bounds()).collect();
        let steps = self.instances.iter().filter_map(|instance| {
            let Bounds { min, max } = meshes[instance.mesh].transformed(&instance.world_from_mesh);
            Some((
                coarse_step([min.as_dvec3(), max.as_dvec3()])?,
                &instance.name,
            ))
        });
        let steps: Vec<_> = steps.collect();
        let Some((step, name)) = steps.iter().max_by(|(a, _), (b, _)| a.total_cmp(b)) else {
            return;
        };
        let count = match steps.len() {
            1 => "one object lies".to_owned(),
            count => format!("{count} objects lie"),
        };
        self.warnings.push(format!(
            "{count} far from the rest of the scene: positions are computed in 32 bits, whose steps there are up to \
             {} (at \"{}\"), so that their light may be wrong",
            in_words(*step),
            name.beginning()
        ));
    }
}

/// The warning of positions that the file stores in 32 bits, with steps of so many metres.
pub(crate) fn coarse_positions(step: f64) -> String {
    format!(
        "the positions lie so far from their origin that the file's 32 bits hold them in steps of {}",
        in_words(step)
    )
}

/// A length in words.
fn in_words(metres: f64) -> String {
    match metres {
        _ if metres < 0.01 => format!("{:.1} mm", metres * 1e3),
        _ if metres < 1.0 => format!("{:.0} cm", metres * 1e2),
        _ => format!("{metres:.0} m"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of two metres.
    fn around(x: f64, y: f64, z: f64) -> Corners {
        let middle = DVec3::new(x, y, z);
        [middle - DVec3::ONE, middle + DVec3::ONE]
    }

    #[test]
    fn only_what_lies_far_for_its_size_moves() {
        let map = DVec3::new(500_000.0, 120.0, -4_200_000.0);
        assert_eq!(origin_of([around(500_000.2, 119.9, -4_200_000.4)]), map);
        assert_eq!(origin_of([]), DVec3::ZERO);
        assert_eq!(origin_of([around(900.0, 0.0, 0.0)]), DVec3::ZERO);
        // The corner of a large terrain is at the origin.
        assert_eq!(origin_of([[DVec3::ZERO, DVec3::splat(1e5)]]), DVec3::ZERO);
        let endless = [DVec3::NEG_INFINITY, DVec3::INFINITY];
        assert_eq!(origin_of([endless]), DVec3::ZERO);
        assert_eq!(origin_of([[DVec3::splat(1e308); 2]]), DVec3::ZERO);
    }

    /// One object far from the others neither moves them away from the origin nor keeps them away from it.
    #[test]
    fn a_stray_object_does_not_decide() {
        let stray = around(1e5, 0.0, 0.0);
        let room = [around(0.0, 0.0, 0.0), around(3.0, 0.0, 0.0), stray];
        assert_eq!(origin_of(room), DVec3::ZERO);
        let far = [
            around(5e5, 0.0, 0.0),
            around(5e5, 0.0, 0.0),
            around(0.0, 0.0, 0.0),
        ];
        let moved = origin_of(far);
        assert!(moved.distance(DVec3::new(5e5, 0.0, 0.0)) <= 1.0, "{moved}");
        // Of two, none is the stray one.
        assert_eq!(origin_of([around(0.0, 0.0, 0.0), stray]), DVec3::ZERO);
    }
}
