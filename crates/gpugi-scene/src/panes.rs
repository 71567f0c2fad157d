//! Panes of a still scene (light path maps), as files store them for programs that relight it.

mod clusters;

use crate::Scene;
use crate::transfer::geometry;
pub use clusters::{ANY_DEPTH, LightPathPanes, MOST_CLUSTERS, MOST_ENTRIES, SurfacePlace};

impl LightPathPanes {
    /// Checks that there are a pane and points for each cluster, and that the panes were made for this scene, with
    /// everything where it is now, of the materials that it has now.
    ///
    /// # Errors
    /// Why they do not fit.
    pub fn check(&self, scene: &Scene) -> Result<(), String> {
        self.check_size()?;
        self.atlas.check(scene)?;
        let is_on_surface = |place: &SurfacePlace| {
            let instance = scene.instances.get(place.instance as usize);
            let mesh = instance.map(|instance| &scene.meshes[instance.mesh]);
            let [u, v] = place.barycentrics;
            mesh.is_some_and(|mesh| (place.triangle as usize) < mesh.indices.len() / 3)
                && u >= 0.0
                && v >= 0.0
                && u + v <= 1.001
        };
        if !self.entries.iter().chain(&self.samples).all(is_on_surface) {
            return Err("points that are on no triangle".to_owned());
        }
        if self.geometry != geometry(scene, &self.atlas) {
            return Err(
                "they were made for another mesh, or something has moved since: bake them again"
                    .to_owned(),
            );
        }
        if self.materials != scene.material_digest() {
            return Err("they were made for other materials: bake them again".to_owned());
        }
        Ok(())
    }
}
