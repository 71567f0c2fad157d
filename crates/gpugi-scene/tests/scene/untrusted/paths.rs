//! Files that a scene refers to.

use std::path::{Path, PathBuf};

use gpugi_scene::{FileResolver, Limits, Resolver, import, import_file, import_file_within};
use serde_json::json;

use crate::untrusted::files::triangle;

/// A folder with a scene, a file beside it, one below it, one outside, and a symbolic link to that one.
fn house() -> PathBuf {
    let root =
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("untrusted-{}", std::process::id()));
    std::fs::remove_dir_all(&root).ok();
    std::fs::create_dir_all(root.join("house/below")).unwrap();
    std::fs::create_dir_all(root.join("beside")).unwrap();
    for place in [
        "secret.bin",
        "house/a.bin",
        "house/below/b.bin",
        "beside/c.bin",
    ] {
        std::fs::write(root.join(place), [0; 36]).unwrap();
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("../secret.bin", root.join("house/link.bin")).unwrap();
        std::os::unix::fs::symlink("..", root.join("house/up")).unwrap();
        std::os::unix::fs::symlink("a.bin", root.join("house/inside.bin")).unwrap();
    }
    root
}

#[test]
fn files_refer_to_nothing_outside_their_folder() {
    let root = house();
    let folder = root.join("house");
    let read = |uri: &str| {
        let scene = triangle(|document| document["buffers"][0]["uri"] = json!(uri));
        std::fs::write(folder.join("a.gltf"), scene).unwrap();
        import_file(&folder.join("a.gltf"), &Limits::default())
    };
    for uri in [
        "a.bin",
        "./a.bin",
        "below/b.bin",
        "below/../a.bin",
        "%61.bin",
        "../house/a.bin",
    ] {
        read(uri).unwrap_or_else(|error| panic!("{error}"));
    }
    let absolute = root.join("secret.bin").display().to_string();
    let addressed = format!("file://{absolute}");
    let mut hostile = vec![
        "../secret.bin",
        "%2e%2e/secret.bin",
        "..%2Fsecret.bin",
        "below/../../secret.bin",
        "./.././secret.bin",
        "../missing.bin",
        "/etc/passwd",
        "//host/share",
        "C:/secret.bin",
        "c:secret.bin",
        "file:a.bin",
        "FILE:/etc/passwd",
        "https://example.org/a.bin",
        &absolute,
        &addressed,
    ];
    if cfg!(unix) {
        read("inside.bin").unwrap();
        hostile.extend(["link.bin", "up/secret.bin"]);
    }
    for uri in hostile {
        let error = read(uri).expect_err(uri);
        assert_eq!(error.place, "buffers[0].uri", "{uri}: {error}");
        let is_below = uri.starts_with(['.', '%', 'b', 'l', 'u']);
        let says_why = if is_below {
            error.reason.contains("--files-from FOLDER allows it")
        } else if uri.contains("://") {
            error.reason.contains("addresses are not read")
        } else {
            error.reason.contains("absolute paths are not read")
        };
        assert!(says_why, "{uri}: {error}");
    }
    // Of every format that refers to files.
    let resolver = FileResolver::new(&folder, Limits::default());
    let text = "mtllib ../secret.bin\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let scene = import("a.obj", text.as_bytes(), &resolver, &Limits::default()).unwrap();
    assert!(
        scene.warnings[0].contains("outside the folder"),
        "{:?}",
        scene.warnings
    );
    // Another folder may be allowed, above or beside the scene's own, with all below it and nothing else.
    let within = |allowed: &Path, uri: &str| {
        FileResolver::within(&folder, allowed, Limits::default()).read(uri)
    };
    within(&root, "a.bin").unwrap();
    within(&root, "../secret.bin").unwrap();
    within(&root, "below/../../beside/c.bin").unwrap();
    within(&root.join("beside"), "a.bin").unwrap();
    within(&root.join("beside"), "../beside/c.bin").unwrap();
    if cfg!(unix) {
        within(&root, "link.bin").unwrap();
        let error = within(&root.join("beside"), "link.bin").unwrap_err();
        assert!(error.contains("symbolic link leads outside"), "{error}");
    }
    for uri in [
        "../secret.bin",
        "../missing.bin",
        "../../secret.bin",
        "../besides/c.bin",
    ] {
        let error = within(&root.join("beside"), uri).unwrap_err();
        assert!(error.contains("--files-from FOLDER allows it"), "{error}");
    }
    for uri in [&absolute, "C:/tex/a.png"] {
        let error = within(&root, uri).unwrap_err();
        assert!(error.contains("absolute paths are not read"), "{error}");
    }
    std::fs::copy(folder.join("a.bin"), root.join("a.bin")).unwrap();
    let scene = triangle(|document| document["buffers"][0]["uri"] = json!("../a.bin"));
    std::fs::write(folder.join("a.gltf"), scene).unwrap();
    let limits = Limits::default();
    import_file(&folder.join("a.gltf"), &limits).unwrap_err();
    import_file_within(&folder.join("a.gltf"), &root, &limits).unwrap();
    // A folder that vanishes is an error.
    std::fs::remove_dir_all(&root).unwrap();
    assert!(resolver.read("a.bin").is_err());
}
