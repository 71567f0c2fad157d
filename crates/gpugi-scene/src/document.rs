//! A scene that is edited, for all who show it.

use crate::{Edit, Scene};

/// A scene and the log of its edits. Whoever shows the scene, such as a renderer or a path tracer, keeps the revision
/// that it has seen and follows by [`Document::since`]: so nobody compares scenes.
///
/// An edit replaces a value, so only the last edit of a value matters. The log is the revision of that edit, for each
/// value that edits replace: the scene holds the value itself. It does not grow, and whoever comes late catches up.
#[derive(Debug, Clone)]
pub struct Document {
    scene: Scene,
    revision: u64,
    log: Log,
}

/// Revisions of the last edits.
#[derive(Debug, Clone, Default)]
struct Log {
    instances: Vec<u64>,
    materials: Vec<u64>,
    meshes: Vec<u64>,
    lights: Vec<u64>,
    all_lights: u64,
    environment: u64,
    media: u64,
    cameras: Vec<u64>,
}

impl Document {
    /// A scene that nobody has edited yet: revision 0.
    pub fn new(scene: Scene) -> Self {
        Self {
            log: Log {
                instances: vec![0; scene.instances.len()],
                materials: vec![0; scene.materials.len()],
                meshes: vec![0; scene.meshes.len()],
                lights: vec![0; scene.lights.len()],
                cameras: vec![0; scene.cameras.len()],
                ..Log::default()
            },
            revision: 0,
            scene,
        }
    }

    /// The scene as it is now.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Grows with every [`Document::edit`].
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Makes edits, whose indices the scene must have. What may refuse them, such as a renderer, is to be asked first.
    pub fn edit(&mut self, edits: &[Edit]) {
        self.revision += 1;
        let (now, log) = (self.revision, &mut self.log);
        for edit in edits {
            match edit {
                Edit::Instance { index, .. } => log.instances[*index] = now,
                Edit::Material { index, .. } => log.materials[*index] = now,
                Edit::Mesh { index, .. } => log.meshes[*index] = now,
                Edit::Light { index, .. } => log.lights[*index] = now,
                Edit::Lights(lights) => {
                    log.all_lights = now;
                    log.lights = vec![now; lights.len()];
                }
                Edit::Environment(_) => log.environment = now,
                Edit::Media(_) => log.media = now,
                Edit::Camera { index, .. } => log.cameras[*index] = now,
            }
            edit.apply_to(&mut self.scene);
        }
    }

    /// The edits that lead from the scene at `revision` to the scene as it is now, one for each value.
    pub fn since(&self, revision: u64) -> Vec<Edit> {
        let (scene, log) = (&self.scene, &self.log);
        let is_new = |of: u64| of > revision;
        let edited = |log: &[u64]| -> Vec<usize> {
            let all = log.iter().enumerate();
            let new = all.filter(|(_, of)| is_new(**of));
            new.map(|(index, _)| index).collect()
        };
        let meshes = edited(&log.meshes).into_iter().map(|index| Edit::Mesh {
            index,
            mesh: scene.meshes[index].clone(),
        });
        let materials = edited(&log.materials)
            .into_iter()
            .map(|index| Edit::Material {
                index,
                material: Box::new(scene.materials[index].clone()),
            });
        let instances = edited(&log.instances)
            .into_iter()
            .map(|index| Edit::Instance {
                index,
                world_from_mesh: scene.instances[index].world_from_mesh,
            });
        let cameras = edited(&log.cameras).into_iter().map(|index| Edit::Camera {
            index,
            camera: scene.cameras[index].clone(),
        });
        let mut edits: Vec<Edit> = meshes
            .chain(materials)
            .chain(instances)
            .chain(cameras)
            .collect();
        if is_new(log.all_lights) {
            edits.push(Edit::Lights(scene.lights.clone()));
        } else {
            let lights = edited(&log.lights).into_iter();
            edits.extend(lights.map(|index| Edit::Light {
                index,
                light: scene.lights[index].clone(),
            }));
        }
        let environment = scene.environment.clone();
        edits.extend(
            environment
                .filter(|_| is_new(log.environment))
                .map(Edit::Environment),
        );
        if is_new(log.media) {
            edits.push(Edit::Media(scene.media.clone()));
        }
        edits
    }
}

#[cfg(test)]
mod tests {
    use glam::{Mat4, Vec3};

    use super::*;
    use crate::builtin::builtin;
    use crate::{Environment, Light, LightKind};

    fn instance(index: usize, x: f32) -> Edit {
        Edit::Instance {
            index,
            world_from_mesh: Mat4::from_translation(Vec3::X * x),
        }
    }

    /// Whoever follows comes to the same scene, however late, and is told each value once.
    #[test]
    fn followers_come_to_the_same_scene() {
        let mut scene = builtin("fog-room", 1).unwrap();
        scene.environment = Some(Environment::default_sky());
        let lamp = Light::new("lamp", LightKind::Point, Vec3::ONE);
        scene.lights = vec![lamp.clone()];
        let mut document = Document::new(scene.clone());
        let mut material = scene.materials[0].clone();
        material.roughness = 0.123;
        let material = Box::new(material);
        let mut bent = scene.meshes[1].as_ref().clone();
        bent.positions[0] *= 1.1;
        let mut sky = scene.environment.clone().unwrap();
        sky.rotation = glam::Quat::from_rotation_y(1.0);
        let mut media = scene.media.clone();
        media[0].extinction *= 2.0;
        let mut camera = scene.cameras[0].clone();
        camera.world_from_view.w_axis.x += 1.0;
        let mut dim = lamp.clone();
        dim.intensity *= 0.5;
        let steps = [
            vec![instance(0, 1.0), instance(1, 2.0), instance(0, 3.0)],
            vec![Edit::Material { index: 0, material }],
            vec![Edit::Mesh {
                index: 1,
                mesh: bent.into(),
            }],
            vec![Edit::Light {
                index: 0,
                light: dim,
            }],
            vec![Edit::Environment(sky), Edit::Media(media)],
            vec![Edit::Camera { index: 0, camera }],
            vec![Edit::Lights(vec![lamp.clone(), lamp])],
            vec![instance(0, 4.0)],
        ];
        let mut states = vec![scene];
        for edits in &steps {
            document.edit(edits);
            states.push(document.scene().clone());
        }
        assert_eq!(document.revision(), steps.len() as u64);
        for (revision, mut scene) in (0..).zip(states) {
            for edit in document.since(revision) {
                edit.apply_to(&mut scene);
            }
            assert!(scene == *document.scene(), "since {revision}");
        }
        assert_eq!(document.since(document.revision()), []);
        assert_eq!(document.since(document.revision() - 1), [instance(0, 4.0)]);
        // Two instances, one of them moved thrice; the other five kinds of values; and both lights at once.
        assert_eq!(document.since(0).len(), 2 + 5 + 1);
    }
}
