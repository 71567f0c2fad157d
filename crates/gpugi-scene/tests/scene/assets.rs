//! Real scenes. They are not part of the repository: the variable GPUGI_ASSETS names their folder.

use std::path::PathBuf;

use glam::Vec3;
use gpugi_scene::{Limits, Scene, import_environment, import_file};

fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("GPUGI_ASSETS").map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: GPUGI_ASSETS does not name a folder with real scenes");
    }
    folder
}

fn load(name: &str) -> Option<Scene> {
    let path = folder()?.join("scenes").join(name);
    Some(import_file(&path, &Limits::default()).unwrap_or_else(|error| panic!("{error}")))
}

#[test]
fn flight_helmet() {
    let Some(scene) = load("flight-helmet/FlightHelmet.gltf") else {
        return;
    };
    let statistics = scene.statistics();
    assert_eq!(statistics.instances, 6);
    assert_eq!(statistics.images, 15);
    assert_eq!(statistics.triangles, 94_722);
    assert_eq!(scene.warnings, Vec::<String>::new());
}

#[test]
fn lamborghini_with_meshopt() {
    let Some(scene) = load("lamborghini.glb") else {
        return;
    };
    assert_eq!(scene.materials.len(), 45);
    assert!(scene.statistics().triangles > 50_000);
    // The corners that the file's accessors claim: wrong filters or strides would miss them.
    let bounds = scene.bounds();
    assert!(
        bounds
            .min
            .abs_diff_eq(Vec3::new(-4.304_321, -0.056_139, -4.127_256), 1e-5)
    );
    assert!(
        bounds
            .max
            .abs_diff_eq(Vec3::new(3.368_451, 2.884_915, 3.383_117), 1e-5)
    );
}

#[test]
fn bridge_garden_with_meshopt_and_glossiness() {
    let Some(scene) = load("bridge-garden.glb") else {
        return;
    };
    assert_eq!(scene.instances.len(), 13);
    assert!(scene.materials.iter().all(|material| material.ior == 0.0));
}

#[test]
fn cornell_box() {
    let Some(scene) = load("cornell-box.glb") else {
        return;
    };
    assert_eq!(scene.statistics().emissive_triangles, 2);
    assert!(
        scene
            .materials
            .iter()
            .any(|material| material.emissive.x == 100.0)
    );
    assert!(scene.meshes.iter().all(|mesh| !mesh.uvs[1].is_empty()));
}

#[test]
fn environments() {
    let Some(folder) = folder() else {
        return;
    };
    for name in ["apartment", "city", "forest", "studio", "sunset", "venice"] {
        let path = folder.join("hdr").join(name).with_extension("exr");
        let environment =
            import_environment(&path, &Limits::default()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(
            (environment.image.width, environment.image.height),
            (512, 256)
        );
    }
}
