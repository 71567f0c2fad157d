//! What the path tracer knows of a scene beside what [`GpuScene`] holds: which lights it samples, where photons are sent,
//! and which solids there are. It follows edits; what they keep is measured once.

use super::Settings;
use super::photons::{self, Aims, Measured};
use super::surroundings::{self, Solid};
use crate::light_paths::LightClass;
use crate::paths::LightTable;
use crate::scene::GpuScene;

/// Lights, solids and aims of a scene.
#[derive(Debug)]
pub(super) struct Lit {
    classes: Vec<LightClass>,
    /// The classes whose photons are kept; `None` if there are no photons at all.
    photon_classes: Option<Vec<LightClass>>,
    /// [`Sky::luminance`](crate::paths::Sky::luminance).
    sky: f64,
    measured: Measured,
    /// Versions of lights and sky that the table is of.
    of: [u64; 2],
    pub table: LightTable,
    pub solids: Vec<Solid>,
    /// Where photons are sent, if there are any to send.
    pub aims: Option<Aims>,
    /// Whether the light tracer finds light of lamps.
    pub has_lamps: bool,
}

impl Lit {
    /// What is to be known of `scene`, for light of some classes. `sky`: [`Sky::luminance`](crate::paths::Sky::luminance).
    pub fn new(
        scene: &GpuScene,
        (settings, classes): (&Settings, &[LightClass]),
        sky: f64,
        has_photons: bool,
    ) -> Self {
        let mut lit = Self {
            classes: classes.to_vec(),
            photon_classes: has_photons.then(|| photons::kept_classes(settings, classes)),
            sky,
            measured: Measured::default(),
            of: versions(scene),
            table: LightTable::new(scene, classes, sky),
            solids: Vec::new(),
            aims: None,
            has_lamps: false,
        };
        lit.follow(scene);
        lit
    }

    /// Follows edits that keep images, the environment's image, too.
    pub fn follow(&mut self, scene: &GpuScene) {
        let now = versions(scene);
        if self.of != now {
            self.table = LightTable::new(scene, &self.classes, self.sky);
            self.of = now;
        }
        self.solids = surroundings::solids(scene);
        if let Some(classes) = &self.photon_classes {
            let rows = &mut self.table.rows;
            let spheres = photons::spheres(scene.kept(), rows, &mut self.measured);
            self.has_lamps = photons::mark_lamps(&spheres, rows);
            self.aims = Aims::new(&spheres, rows, classes, &self.solids);
        }
    }
}

/// Versions of what the light table is made of.
fn versions(scene: &GpuScene) -> [u64; 2] {
    [scene.versions.lights, scene.versions.sky]
}
