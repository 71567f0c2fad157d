//! Precomputed transfer vectors of a still scene (radiance transfer), as files store them for programs that relight it.

mod vectors;

use blake3::{Hash, Hasher};

use crate::{Atlas, Mesh, Scene};
pub use vectors::{MOST_BOUNCES, ORDERS, TransferVectors};

impl TransferVectors {
    /// Checks that there is a coefficient per function and texel, and that the vectors were made for this scene, with
    /// everything where it is now.
    ///
    /// # Errors
    /// Why they do not fit.
    pub fn check(&self, scene: &Scene) -> Result<(), String> {
        if !(1..=MOST_BOUNCES).contains(&self.bounces) {
            return Err(format!(
                "{} bounces are not in 1 to {MOST_BOUNCES}",
                self.bounces
            ));
        }
        self.check_size()?;
        self.atlas.check(scene)?;
        if self.geometry != geometry(scene, &self.atlas) {
            return Err(
                "they were made for another mesh, or something has moved since: bake them again"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

/// BLAKE3 of all triangles: where they lie in the world and in the atlas, which must belong to the scene. How vertices
/// are shared does not matter.
pub fn geometry(scene: &Scene, atlas: &Atlas) -> [u8; 32] {
    let mut hasher = Hasher::new();
    // Once per mesh: a short file may place a large mesh any number of times.
    let mut meshes: Vec<Option<Hash>> = vec![None; scene.meshes.len()];
    for (instance, place) in scene.instances.iter().zip(&atlas.instances) {
        let of_mesh =
            meshes[instance.mesh].get_or_insert_with(|| triangles(&scene.meshes[instance.mesh]));
        hasher.update(bytemuck::cast_slice(
            &instance.world_from_mesh.to_cols_array(),
        ));
        hasher.update(of_mesh.as_bytes());
        let page = place.as_ref().map_or(u32::MAX, |place| place.page);
        hasher.update(&page.to_le_bytes());
        if let Some(place) = place {
            hasher.update(bytemuck::cast_slice(&place.corners));
        }
    }
    *hasher.finalize().as_bytes()
}

/// BLAKE3 of a mesh's triangles: the positions of their corners.
fn triangles(mesh: &Mesh) -> Hash {
    let mut hasher = Hasher::new();
    for &index in &mesh.indices {
        hasher.update(bytemuck::bytes_of(&mesh.positions[index as usize]));
    }
    hasher.finalize()
}
