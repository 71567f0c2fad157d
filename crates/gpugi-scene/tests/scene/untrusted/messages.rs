//! What errors and warnings say.

use gpugi_scene::{Limits, import};
use serde_json::json;

use crate::untrusted::files::{Nothing, triangle};

#[test]
fn messages_say_where_and_quote_little() {
    let at = |change: fn(&mut serde_json::Value)| {
        import("a.gltf", &triangle(change), &Nothing, &Limits::default()).unwrap_err()
    };
    let error = at(|document| document["nodes"][0]["mesh"] = json!(-1));
    assert_eq!(error.place, "nodes[0].mesh", "{error}");
    let error = at(|document| document["buffers"][0]["byteLength"] = json!("x".repeat(10_000)));
    assert_eq!(error.place, "buffers[0].byteLength");
    assert!(error.reason.len() < 250, "{error}");
    let long = "y".repeat(5000);
    let error = at(|document| document["accessors"][0]["type"] = json!("y".repeat(5000)));
    assert!(
        !error.reason.contains(&long) && error.reason.contains("yyy..."),
        "{error}"
    );
    let mut file = b"glTF\x02\0\0\0\x20\0\0\0\x04\0\0\0".to_vec();
    file.extend(b"N\":4    more bytes");
    let error = import("a.glb", &file, &Nothing, &Limits::default()).unwrap_err();
    assert!(error.reason.contains(r#""N\":4""#), "{error}");
}

#[test]
fn warnings_do_not_flood() {
    let flat = json!({ "mesh": 0, "scale": [0, 0, 0] });
    let file = triangle(|document| document["nodes"] = json!(vec![flat; 5000]));
    let scene = import("a.gltf", &file, &Nothing, &Limits::default()).unwrap();
    assert_eq!(scene.warnings.len(), 101);
    assert_eq!(scene.warnings[100], "and 4900 more warnings");
}
