//! Image files: decoded exactly, limited before allocation, written whole or not at all.

use std::io::Cursor;
use std::time::{Duration, Instant};

use gpugi_scene::image::{
    decode_color, decode_radiance, load_radiance, replace_file, save_exr, save_hdr, save_png,
};
use gpugi_scene::{Image, ImportError, Limits, Pixels};
use image::{DynamicImage, ImageFormat, Rgb, RgbImage};

const LIMITS: Limits = Limits {
    file_bytes: 1 << 24,
    image_side: 64,
    image_bytes: 1 << 16,
    scene_bytes: 0,
    expansion: 1024,
    displaced_triangles: 0,
};

fn encoded(image: impl Into<DynamicImage>, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.into().write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// A 3 x 2 picture with different texels.
fn picture() -> RgbImage {
    RgbImage::from_fn(3, 2, |x, y| Rgb([x as u8 * 100, y as u8 * 200, 50]))
}

/// Floats, each of them exact in half precision too.
fn radiance() -> image::Rgb32FImage {
    image::Rgb32FImage::from_fn(3, 2, |x, y| Rgb([x as f32 * 8.0, y as f32 * 0.5, 0.25]))
}

fn ktx2(format: u32, width: u32, height: u32, supercompression: u32, texels: &[u8]) -> Vec<u8> {
    let mut bytes = ktx2_magic().to_vec();
    let level = 80 + 24 + 4;
    for word in [
        format,
        1,
        width,
        height,
        0,
        0,
        1,
        1,
        supercompression,
        104,
        4,
        0,
        0,
    ] {
        bytes.extend(word.to_le_bytes());
    }
    for offset in [0_u64, 0, level, texels.len() as u64, texels.len() as u64] {
        bytes.extend(offset.to_le_bytes());
    }
    bytes.extend(4_u32.to_le_bytes());
    bytes.extend(texels);
    bytes
}

fn ktx2_magic() -> [u8; 12] {
    *b"\xABKTX 20\xBB\r\n\x1A\n"
}

fn color(bytes: &[u8]) -> Result<Vec<u8>, ImportError> {
    decode_color("test", bytes, &LIMITS).map(|image| match image.pixels {
        Pixels::Rgba8(texels) => texels,
        Pixels::Rgba32Float(_) => panic!("a colour image has 8 bits"),
    })
}

fn floats(bytes: &[u8]) -> Result<Vec<f32>, ImportError> {
    decode_radiance("test", bytes, &LIMITS).map(|image| match image.pixels {
        Pixels::Rgba32Float(texels) => texels,
        Pixels::Rgba8(_) => panic!("radiance is floats"),
    })
}

#[test]
fn png_texels_are_exact() {
    let texels = color(&encoded(picture(), ImageFormat::Png)).unwrap();
    assert_eq!(texels[..8], [0, 0, 50, 255, 100, 0, 50, 255]);
    assert_eq!(texels[20..], [200, 200, 50, 255]);
    let grey = image::GrayAlphaImage::from_pixel(1, 1, image::LumaA([7, 9]));
    assert_eq!(
        color(&encoded(grey, ImageFormat::Png)).unwrap(),
        [7, 7, 7, 9]
    );
}

#[test]
fn sixteen_bits_become_eight() {
    let image = image::ImageBuffer::from_pixel(1, 1, Rgb([65535_u16, 257 * 128, 0]));
    let bytes = encoded(DynamicImage::ImageRgb16(image), ImageFormat::Png);
    assert_eq!(color(&bytes).unwrap(), [255, 128, 0, 255]);
}

#[test]
fn jpeg_texels_are_close() {
    let image = RgbImage::from_pixel(8, 8, Rgb([200, 100, 50]));
    let texels = color(&encoded(image, ImageFormat::Jpeg)).unwrap();
    for (found, expected) in texels[..4].iter().zip([200_u8, 100, 50, 255]) {
        assert!(found.abs_diff(expected) <= 3, "{texels:?}");
    }
}

#[test]
fn ktx2_formats() {
    // Vulkan's numbers: R8G8B8A8_SRGB, R8G8B8_UNORM, R8_UNORM.
    assert_eq!(
        color(&ktx2(43, 1, 1, 0, &[1, 2, 3, 4])).unwrap(),
        [1, 2, 3, 4]
    );
    assert_eq!(
        color(&ktx2(23, 1, 1, 0, &[1, 2, 3])).unwrap(),
        [1, 2, 3, 255]
    );
    assert_eq!(
        color(&ktx2(9, 2, 1, 0, &[5, 6])).unwrap(),
        [5, 5, 5, 255, 6, 6, 6, 255]
    );
    // R16G16B16A16_SFLOAT: 1, 2, 0.5, 0. R32G32B32_SFLOAT.
    let halves = [0x3C00_u16, 0x4000, 0x3800, 0];
    let halves = ktx2(97, 1, 1, 0, bytemuck::cast_slice(&halves));
    assert_eq!(floats(&halves).unwrap(), [1.0, 2.0, 0.5, 1.0]);
    let words = ktx2(106, 1, 1, 0, bytemuck::cast_slice(&[9.0_f32, 8.0, 7.0]));
    assert_eq!(floats(&words).unwrap(), [9.0, 8.0, 7.0, 1.0]);
    // 8 bits are linear or sRGB, as the format says.
    assert_eq!(
        floats(&ktx2(9, 1, 1, 0, &[51])).unwrap(),
        [0.2, 0.2, 0.2, 1.0]
    );
    let srgb = floats(&ktx2(29, 1, 1, 0, &[188, 0, 255])).unwrap();
    assert!(
        (srgb[0] - 0.502_886_5).abs() < 1e-5 && srgb[2] == 1.0,
        "{srgb:?}"
    );
}

#[test]
fn ktx2_that_is_not_read_is_refused_clearly() {
    let refused = |bytes: &[u8], reason: &str| {
        let error = color(bytes).unwrap_err();
        assert!(error.reason.contains(reason), "{error}");
    };
    refused(&ktx2(37, 1, 1, 2, &[0; 16]), "supercompression");
    // Without a descriptor, it is no Basis Universal.
    refused(
        &ktx2(0, 1, 1, 1, &[0; 16]),
        "parts do not lie within the file",
    );
    refused(&ktx2(145, 4, 4, 0, &[0; 16]), "BC7");
    refused(&ktx2(109, 1, 1, 0, &[0; 16]), "floats");
    refused(&ktx2(37, 2, 2, 0, &[0; 15]), "15 bytes of texels where 16");
    refused(&ktx2(37, 65, 1, 0, &[0; 15]), "limit of 64");
}

#[test]
fn radiance_formats_are_exact() {
    let expected: Vec<f32> = radiance()
        .pixels()
        .flat_map(|texel| [texel[0], texel[1], texel[2], 1.0])
        .collect();
    for format in [ImageFormat::Hdr, ImageFormat::OpenExr] {
        assert_eq!(
            floats(&encoded(radiance(), format)).unwrap(),
            expected,
            "{format:?}"
        );
    }
}

#[test]
fn low_dynamic_range_is_linearised() {
    let image = RgbImage::from_pixel(1, 1, Rgb([0, 188, 255]));
    let texels = floats(&encoded(image, ImageFormat::Png)).unwrap();
    assert!((texels[1] - 0.502_886_5).abs() < 1e-5, "{texels:?}");
    assert_eq!((texels[0], texels[2], texels[3]), (0.0, 1.0, 1.0));
}

#[test]
fn radiance_is_no_material_texture() {
    for format in [ImageFormat::Hdr, ImageFormat::OpenExr] {
        let error = color(&encoded(radiance(), format)).unwrap_err();
        assert!(error.reason.contains("radiance"), "{error}");
    }
}

#[test]
fn texels_that_are_not_finite_are_named_and_negative_ones_become_zero() {
    for (value, is_fine) in [(f32::NAN, false), (f32::INFINITY, false), (-1.0, true)] {
        let mut image = radiance();
        image.get_pixel_mut(2, 1)[1] = value;
        match floats(&encoded(image, ImageFormat::OpenExr)) {
            Ok(texels) => assert!(is_fine && texels[21] == 0.0 && texels[20] == 16.0),
            Err(error) => {
                assert!(!is_fine, "{error}");
                assert_eq!(error.place, "texel (2, 1)");
            }
        }
    }
}

#[test]
fn sizes_are_limited_before_allocation() {
    let wide = encoded(RgbImage::new(65, 1), ImageFormat::Png);
    assert!(color(&wide).unwrap_err().reason.contains("limit of 64"));
    let small = Limits {
        image_bytes: 23,
        ..LIMITS
    };
    let bytes = encoded(picture(), ImageFormat::Png);
    let error = decode_color("test", &bytes, &small).unwrap_err();
    assert!(error.reason.contains("24 bytes exceed the 23"), "{error}");
    let error = decode_radiance("test", &bytes, &small).unwrap_err();
    assert!(error.reason.contains("96 bytes exceed the 23"), "{error}");
}

/// A PNG whose header claims 60,000 x 60,000 texels, a few bytes long.
#[test]
fn bombs_are_refused_at_once() {
    let limits = Limits {
        image_side: 60_000,
        image_bytes: 1 << 30,
        ..LIMITS
    };
    let mut png = encoded(picture(), ImageFormat::Png);
    png[16..20].copy_from_slice(&60_000_u32.to_be_bytes());
    png[20..24].copy_from_slice(&60_000_u32.to_be_bytes());
    let checksum = crc(&png[12..29]);
    png[29..33].copy_from_slice(&checksum.to_be_bytes());
    let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n".to_vec();
    let ktx2 = ktx2(37, 60_000, 60_000, 0, &[0; 16]);
    for bytes in [png, hdr, ktx2] {
        let start = Instant::now();
        let error = decode_radiance("test", &bytes, &limits).unwrap_err();
        assert!(error.reason.contains("60000 x 60000"), "{error}");
        assert!(start.elapsed() < Duration::from_millis(200));
    }
}

/// The checksum of PNG chunks.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xEDB8_8320 * (crc & 1))
        })
    })
}

#[test]
fn what_is_no_image_is_said_so() {
    for (bytes, reason) in [
        (&b""[..], "empty"),
        (b"hello", "no image"),
        (b"GIF89a.....", "Gif"),
        (b"\x89PNG\r\n\x1A\n", ""),
    ] {
        let error = color(bytes).unwrap_err();
        assert!(error.reason.contains(reason), "{error}");
        assert_eq!(error.file, "test");
    }
}

#[test]
fn damaged_images_survive() {
    let big = image::Rgb32FImage::from_fn(20, 20, |x, y| Rgb([x as f32, y as f32, 1.0]));
    let noise = RgbImage::from_fn(20, 20, |x, y| Rgb([(x * y) as u8, (x ^ y) as u8, y as u8]));
    let texels: Vec<f32> = (0..400).map(|i| i as f32).collect();
    for (name, bytes) in [
        ("png", encoded(noise.clone(), ImageFormat::Png)),
        ("jpeg", encoded(noise, ImageFormat::Jpeg)),
        ("hdr", encoded(big.clone(), ImageFormat::Hdr)),
        ("exr", encoded(big, ImageFormat::OpenExr)),
        ("ktx2", ktx2(100, 20, 20, 0, bytemuck::cast_slice(&texels))),
    ] {
        let mut decoded = 0;
        for case in 0..800_u64 {
            let damaged = damage(&bytes, case);
            let start = Instant::now();
            decoded += usize::from(decode_radiance(name, &damaged, &LIMITS).is_ok());
            let _ = decode_color(name, &damaged, &LIMITS);
            let took = start.elapsed();
            assert!(
                took < Duration::from_secs(2),
                "{name} case {case} took {took:?}"
            );
        }
        println!("{name}: {decoded} of 800 damaged files decoded");
    }
}

/// Changes one to four bytes, mostly of the header, and cuts every eighth file. The same damage in every run.
fn damage(bytes: &[u8], case: u64) -> Vec<u8> {
    let mut state = (case + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mut below = |bound: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % bound as u64) as usize
    };
    let mut damaged = bytes.to_vec();
    for _ in 0..=below(4) {
        let reach = if below(2) == 0 {
            300.min(bytes.len())
        } else {
            bytes.len()
        };
        damaged[below(reach)] = [0, 1, 0x7F, 0x80, 0xFF, below(256) as u8][below(6)];
    }
    if below(8) == 0 {
        damaged.truncate(below(bytes.len()));
    }
    if bytes.starts_with(b"\x89PNG") {
        repair_checksums(&mut damaged);
    }
    damaged
}

/// Makes the checksums of PNG chunks right, so that the damage reaches what stands behind them.
fn repair_checksums(png: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = png.get(at..at + 4) {
        let length = u32::from_be_bytes(length.try_into().unwrap()) as usize;
        let end = at + 8 + length;
        let Some(checksum) = png.get(at + 4..end).map(crc) else {
            return;
        };
        let Some(stored) = png.get_mut(end..end + 4) else {
            return;
        };
        stored.copy_from_slice(&checksum.to_be_bytes());
        at = end + 4;
    }
}

/// A folder of this test alone, removed at the end.
struct Folder(std::path::PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("gpugi-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.0).unwrap();
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn saved_images_read_back() {
    let folder = Folder::new("saved");
    let path = folder.0.join("a.png");
    save_png(&path, 1, 2, &[1, 2, 3, 4, 5, 6, 7, 8]).unwrap();
    assert_eq!(
        color(&std::fs::read(&path).unwrap()).unwrap(),
        [1, 2, 3, 4, 5, 6, 7, 8]
    );
    let values = [1.0, 2.0, 0.5, 0.0, 64.0, 0.25];
    let expected = [1.0, 2.0, 0.5, 1.0, 0.0, 64.0, 0.25, 1.0];
    // HDR shares an exponent, so 0.25 beside 64 is lost there.
    let shared = [1.0, 2.0, 0.5, 1.0, 0.0, 64.0, 0.0, 1.0];
    let read = |path| -> Image { load_radiance(path, &LIMITS).unwrap() };
    let path = folder.0.join("a.exr");
    save_exr(&path, 2, 1, &values).unwrap();
    assert_eq!(read(&path).pixels, Pixels::Rgba32Float(expected.to_vec()));
    let path = folder.0.join("a.hdr");
    save_hdr(&path, 2, 1, &values).unwrap();
    let Pixels::Rgba32Float(found) = read(&path).pixels else {
        panic!("radiance is floats");
    };
    for (found, expected) in found.iter().zip(shared) {
        assert!(
            (found - expected).abs() <= 0.25,
            "{found} is not {expected}"
        );
    }
    assert_eq!(folder.names().len(), 3, "no temporary file is left");
}

#[test]
fn a_failure_keeps_what_was_there() {
    let folder = Folder::new("kept");
    let path = folder.0.join("a.png");
    std::fs::write(&path, "precious").unwrap();
    save_png(&path, 2, 2, &[0; 15]).unwrap_err();
    let error = replace_file(&path, |file| {
        std::io::Write::write_all(file, b"half")?;
        Err(std::io::Error::other("the disk is full"))
    })
    .unwrap_err();
    assert!(
        error.to_string().contains("a.png") && error.to_string().contains("full"),
        "{error}"
    );
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    assert_eq!(folder.names(), ["a.png"]);
    let missing = folder.0.join("gone").join("a.png");
    let error = save_png(&missing, 1, 1, &[0; 4]).unwrap_err();
    assert!(error.to_string().contains("gone"), "{error}");
}

#[test]
fn a_missing_file_is_named() {
    let error = load_radiance(std::path::Path::new("gone.exr"), &LIMITS).unwrap_err();
    assert_eq!(
        (error.file.as_str(), error.place.as_str()),
        ("gone.exr", "open")
    );
}

/// A full disk, and a folder that vanishes: an error that names the file, and nothing under the final name.
#[test]
fn faults_while_writing_leave_nothing_broken() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("images-faults");
    std::fs::remove_dir_all(&folder).ok();
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("a.bin");
    let full = replace_file(&path, |file| {
        std::io::Write::write_all(file, b"the beginning")?;
        Err(std::io::ErrorKind::StorageFull.into())
    });
    let error = full.unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
    assert!(error.to_string().contains("a.bin"), "{error}");
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0);
    let vanished = replace_file(&path, |file| {
        std::io::Write::write_all(file, b"all of it")?;
        std::fs::remove_dir_all(&folder)
    });
    assert!(vanished.unwrap_err().to_string().contains("a.bin"));
    assert!(!folder.exists());
    assert!(save_png(&path, 1, 1, &[0; 4]).is_err());
}
