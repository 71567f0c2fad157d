//! Scenes as plain data, for programs that read them in one process and use them in another.

use gpugi_scene::Scene;
use gpugi_scene::builtin::{SCENES, builtin};

#[test]
fn a_scene_is_the_same_from_its_bytes() {
    for name in SCENES.iter().map(|scene| scene.name) {
        let mut scene = builtin(name, 1).unwrap();
        scene.build_trees();
        assert!(scene.meshes.iter().all(|mesh| mesh.tree.is_some()));
        let bytes = postcard::to_allocvec(&scene).unwrap();
        let again: Scene = postcard::from_bytes(&bytes).unwrap();
        assert!(again == scene, "{name}");
        assert!(
            postcard::from_bytes::<Scene>(&bytes[..bytes.len() / 2]).is_err(),
            "half of {name}"
        );
    }
}
