//! Pictures that claim more than their bytes can hold, and those that only look so.

use std::io::Cursor;

use gpugi_scene::image::{decode_color, decode_radiance};
use gpugi_scene::{Limits, Resolver, import};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{GrayImage, ImageFormat, Luma, Rgb, RgbImage};

use crate::untrusted::files::soon;

#[test]
fn pictures_that_claim_more_than_their_bytes_can_hold() {
    let encoded = |format| {
        let mut bytes = Cursor::new(Vec::new());
        RgbImage::new(8, 8).write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let mut jpeg = encoded(ImageFormat::Jpeg);
    let frame = jpeg
        .windows(2)
        .position(|marker| marker == [0xff, 0xc0])
        .unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0x40, 0, 0x40, 0]);
    for decode in [decode_color, decode_radiance] {
        let error = soon(|| decode("a.jpg", &jpeg, &Limits::default())).unwrap_err();
        assert!(error.reason.contains("--limits expansion"), "{error}");
    }
    let mut png = encoded(ImageFormat::Png);
    png[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
    for decode in [decode_color, decode_radiance] {
        soon(|| decode("a.png", &png, &Limits::default())).unwrap_err();
    }
    let mut scans = encoded(ImageFormat::Jpeg);
    let end = scans.len() - 2;
    scans.splice(end..end, [0xff, 0xda].repeat(200));
    let error = decode_color("a.jpg", &scans, &Limits::default()).unwrap_err();
    assert!(error.reason.contains("201 scans"), "{error}");
    let mut raised = Limits::default();
    raised.set("expansion=10000000, images=1KiB").unwrap();
    let error = decode_color("a.jpg", &jpeg, &raised).unwrap_err();
    assert!(error.reason.contains("--limits images"), "{error}");
}

/// What a segment holds, and what follows the picture, are no scans.
#[test]
fn pictures_with_others_inside_and_behind() {
    let mut jpeg = Cursor::new(Vec::new());
    let picture = RgbImage::from_pixel(8, 8, Rgb([200, 20, 20]));
    picture.write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
    let plain = jpeg.into_inner();
    let scans = [0xff, 0xda].repeat(500);
    let length = u16::to_be_bytes(scans.len() as u16 + 2);
    let segment = [&[0xff, 0xe5], &length[..], &scans].concat();
    let comment = [&[0xff, 0xfe], &length[..], &scans].concat();
    let decode = |bytes: &[u8]| decode_color("a.jpg", bytes, &Limits::default());
    let expected = decode(&plain).unwrap();
    let with = |start: &[u8]| [&plain[..2], start, &plain[2..], &scans].concat();
    for bytes in [with(&[]), with(&segment), with(&comment)] {
        assert_eq!(decode(&bytes).unwrap(), expected);
    }
    // A segment hides no scans of the picture itself.
    let end = plain.len() - 2;
    for hidden in [&segment, &comment] {
        let bytes = [&plain[..end], hidden, &plain[end..]].concat();
        let error = decode(&bytes).unwrap_err();
        assert!(error.reason.contains("501 scans"), "{error}");
    }
}

/// Masks of one colour, of the largest size: the first is honest, and more of them exceed what the file may expand to.
#[test]
fn large_flat_images() {
    let mut mask = Cursor::new(Vec::new());
    let texels = GrayImage::from_pixel(16_384, 16_384, Luma([255]));
    let (best, filter) = (CompressionType::Best, FilterType::NoFilter);
    let encoder = PngEncoder::new_with_quality(&mut mask, best, filter);
    texels.write_with_encoder(encoder).unwrap();
    let mask = mask.into_inner();
    assert!(mask.len() < 1 << 20);
    struct Masks(Vec<u8>);
    impl Resolver for Masks {
        fn read(&self, uri: &str) -> Result<Vec<u8>, String> {
            Ok(match uri {
                "a.mtl" => b"newmtl a\nmap_Kd 1.png\nmap_Ke 2.png\n".to_vec(),
                _ => self.0.clone(),
            })
        }
    }
    let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
    let scene = import("a.obj", text.as_bytes(), &Masks(mask), &Limits::default()).unwrap();
    assert_eq!(scene.images.len(), 1);
    let warning = &scene.warnings[0];
    assert!(warning.contains("--limits expansion=N"), "{warning}");
}
