//! OpenEXR whose header or table of chunks is wrong.

use std::io::Cursor;

use gpugi_scene::image::decode_radiance;
use gpugi_scene::{ImportError, Limits};
use image::{ImageFormat, Rgb, Rgb32FImage};

use crate::untrusted::files::soon;

fn radiance_file() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let image = Rgb32FImage::from_fn(70, 3, |x, y| Rgb([x as f32, y as f32, 0.5]));
    image.write_to(&mut bytes, ImageFormat::OpenExr).unwrap();
    bytes.into_inner()
}

/// The offset of the value of an attribute of an OpenEXR file.
fn attribute(exr: &[u8], name: &str) -> usize {
    let name = format!("{name}\0");
    let at = exr
        .windows(name.len())
        .position(|window| window == name.as_bytes())
        .unwrap()
        + name.len();
    let kind = exr[at..].iter().position(|&byte| byte == 0).unwrap();
    at + kind + 1 + 4
}

fn exr_error(change: impl FnOnce(&mut Vec<u8>)) -> ImportError {
    let mut bytes = radiance_file();
    change(&mut bytes);
    soon(|| decode_radiance("a.exr", &bytes, &Limits::default())).expect_err("the file is damaged")
}

#[test]
fn exr_sizes_are_checked_before_they_are_believed() {
    let image = decode_radiance("a.exr", &radiance_file(), &Limits::default()).unwrap();
    assert_eq!((image.width, image.height), (70, 3));
    let window = |name: &'static str, right: i32| {
        move |bytes: &mut Vec<u8>| {
            let at = attribute(bytes, name) + 8;
            bytes[at..at + 4].copy_from_slice(&right.to_le_bytes());
        }
    };
    for (right, reason) in [
        (i32::MAX, "no rectangle"),
        (-7, "no rectangle"),
        (1 << 20, "limit of 16384"),
    ] {
        let error = exr_error(window("dataWindow", right));
        assert_eq!(error.place, "attribute dataWindow", "{error}");
        assert!(error.reason.contains(reason), "{error}");
    }
    assert!(
        exr_error(window("displayWindow", 1 << 20))
            .reason
            .contains("limit of 16384")
    );
    let lines = |bytes: &mut Vec<u8>| {
        let at = attribute(bytes, "dataWindow") + 12;
        bytes[at..at + 4].copy_from_slice(&16_000_i32.to_le_bytes());
    };
    assert_eq!(exr_error(lines).place, "table of chunks");
    // The first of two tiles follows the table.
    let table = |bytes: &[u8]| {
        let starts = |at: &usize| bytes[*at..*at + 8] == (*at as u64 + 16).to_le_bytes();
        (0..bytes.len() - 8).find(starts).unwrap()
    };
    for wrong in [0, 1 << 40, u64::MAX] {
        let error = exr_error(|bytes| {
            let at = table(bytes);
            bytes[at..at + 8].copy_from_slice(&u64::to_le_bytes(wrong));
        });
        assert_eq!(error.place, "chunk 0", "{error}");
    }
    let error = exr_error(|bytes| {
        let at = table(bytes);
        let first: [u8; 8] = bytes[at..at + 8].try_into().unwrap();
        bytes[at + 8..at + 16].copy_from_slice(&first);
    });
    assert!(error.reason.contains("same place"), "{error}");
    let error = exr_error(|bytes| {
        let at = attribute(bytes, "compression");
        bytes[at] = 77;
    });
    assert_eq!(error.place, "attribute compression");
    let error = exr_error(|bytes| {
        let at = attribute(bytes, "channels") - 4;
        bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    });
    assert_eq!(error.place, "attribute channels");
}
