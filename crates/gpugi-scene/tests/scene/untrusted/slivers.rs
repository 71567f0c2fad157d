//! Meshes that no atlas has room for.

use glam::{Mat4, Vec3};
use gpugi_scene::{Atlas, AtlasOptions, Material, Mesh};

use crate::untrusted::files::shown;

#[test]
fn meshes_of_slivers_alone_are_not_in_the_atlas() {
    let needle = |height: f32| Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::new(0.5, height, 0.0)],
        normals: vec![Vec3::Z; 3],
        indices: vec![0, 1, 2],
        ..Mesh::default()
    };
    let mut scene = shown(Material::default());
    for height in [1e-4, 1e-5, 1e-6, 1e-7, 1e-9, 1e-20] {
        let mesh = scene.add_mesh(needle(height));
        scene.add_instance("needle", mesh, 0, Mat4::IDENTITY);
    }
    let options = AtlasOptions {
        size: 64,
        ..AtlasOptions::default()
    };
    let atlas = Atlas::new(&scene, &options).unwrap();
    let placed: Vec<bool> = atlas.instances.iter().map(Option::is_some).collect();
    assert_eq!(placed, [true, true, false, false, false, false, false]);
    assert_eq!(atlas.slivers(&scene), 5);
    scene.instances.drain(..2);
    let alone = Atlas::new(&scene, &options).unwrap();
    assert!(alone.instances.iter().all(Option::is_none));
    assert_eq!(alone.slivers(&scene), 5);
}
