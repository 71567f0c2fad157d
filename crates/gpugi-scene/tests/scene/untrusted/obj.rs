//! OBJ that repeats itself.

use std::cell::RefCell;

use gpugi_scene::export::export_scene;
use gpugi_scene::{Limits, Resolver, import};

use crate::untrusted::files::{Nothing, soon};

#[test]
fn line_continuations_take_linear_time() {
    let mut text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf".to_owned();
    text += &"\\\n".repeat(300_000);
    text += " 1 2 3\n";
    let scene = soon(|| import("a.obj", text.as_bytes(), &Nothing, &Limits::default())).unwrap();
    assert_eq!(scene.meshes[0].indices, [0, 1, 2]);
}

#[test]
fn a_material_library_is_read_once() {
    struct Library(RefCell<usize>);
    impl Resolver for Library {
        fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
            if uri != "a.mtl" {
                return Err("no such file".into());
            }
            *self.0.borrow_mut() += 1;
            Ok(b"newmtl red\nKd 1 0 0\n".to_vec())
        }
    }
    let library = Library(RefCell::new(0));
    let lines = "mtllib a.mtl\nmtllib a.mtl a.mtl\n".repeat(100);
    let text = format!("{lines}v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n");
    let scene = import("a.obj", text.as_bytes(), &library, &Limits::default()).unwrap();
    assert_eq!((library.0.into_inner(), scene.materials.len()), (1, 1));
}

/// A name of 2 MB that 50,000 changes of material share is compared once, and exported cut.
#[test]
fn long_names_take_linear_time() {
    let mut text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\ng {}\n", "x".repeat(2_000_000));
    for change in 0..50_000 {
        text += &format!("usemtl {}\nf 1 2 3\n", change % 100);
    }
    let scene = soon(|| import("a.obj", text.as_bytes(), &Nothing, &Limits::default())).unwrap();
    assert_eq!(
        (scene.instances.len(), scene.instances[0].name.len()),
        (100, 2_000_000)
    );
    let file = export_scene(&scene).unwrap().glb;
    assert!(file.len() < 1 << 20, "{}", file.len());
}
