//! `gpugi convert`.

use crate::common::{folder, gpugi};
use gpugi_scene::{Limits, import_file};

#[test]
fn scenes_become_files_that_other_programs_read() {
    let folder = folder("convert");
    let path = |name: &str| folder.join(name).display().to_string();
    let convert = |scene: &str, output: &str, options: &[&str]| {
        let done = gpugi(&[&["convert", scene, "-o", output, "--quiet"][..], options].concat());
        let errors = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{errors}");
        let scene = import_file(output.as_ref(), &Limits::default());
        scene.unwrap_or_else(|error| panic!("{error}"))
    };
    let room = gpugi_scene::builtin::builtin("room", 1).expect("a scene");
    let first = convert("room", &path("room.glb"), &[]);
    assert_eq!(first.instances.len(), room.instances.len());
    assert_eq!(first.lights.len(), 2);
    // A glTF file stays what it is but for what is asked.
    let again = convert(&path("room.glb"), &path("again.glb"), &[]);
    assert_eq!(again.meshes, first.meshes);
    assert_eq!(again.materials, first.materials);
    let dark = convert(&path("room.glb"), &path("dark.glb"), &["--drop-lights"]);
    assert_eq!(
        (dark.lights.len(), dark.instances.len()),
        (0, first.instances.len())
    );
    let options = ["--light-units", "photometric", "--without", "*spot*"];
    let bright = convert(&path("room.glb"), &path("bright.glb"), &options);
    assert_eq!(bright.lights.len(), 1);
    let same = |name: &str| {
        first
            .lights
            .iter()
            .find(|light| light.name.as_str() == name)
    };
    for light in &bright.lights {
        let watts = same(light.name.as_str()).expect("a light").intensity;
        assert!((light.intensity / watts - 683.0).abs().max_element() < 0.01);
    }

    let refused = gpugi(&["convert", "room", "-o", &path("room.usdz")]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains(".glb"));
}
