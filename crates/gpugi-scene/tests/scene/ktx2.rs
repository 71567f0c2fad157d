//! KTX2 files that gpugi writes, checked with an independent reader.

use gpugi_scene::image::{HalfTexture, decode_radiance, save_ktx2};
use gpugi_scene::{Limits, Pixels};
use half::f16;
use ktx2::{ColorModel, ColorPrimaries, Format, Reader, TransferFunction};

/// Texels that all differ.
fn texture(size: [u32; 2], faces: u32, levels: u32) -> HalfTexture {
    let mut number = 0.0;
    let mut texel = || {
        number += 0.25;
        [number, -number, 1e-3 * number, 1.0].map(f16::from_f32)
    };
    let levels = (0..levels).map(|level| {
        let side = |side: u32| (side >> level).max(1);
        (0..side(size[0]) * side(size[1]) * faces)
            .map(|_| texel())
            .collect()
    });
    HalfTexture {
        size,
        depth: 1,
        faces,
        levels: levels.collect(),
    }
}

fn saved(name: &str, texture: &HalfTexture) -> std::io::Result<Vec<u8>> {
    let name = format!("gpugi-{name}-{}.ktx2", std::process::id());
    let path = std::env::temp_dir().join(name);
    save_ktx2(&path, texture)?;
    let bytes = std::fs::read(&path)?;
    std::fs::remove_file(path)?;
    Ok(bytes)
}

#[test]
fn a_cube_map_reads_back() {
    let cube = texture([8, 8], 6, 3);
    let bytes = saved("cube", &cube).unwrap();
    let reader = Reader::new(&bytes).unwrap();
    let header = reader.header();
    assert_eq!(header.format, Some(Format::R16G16B16A16_SFLOAT));
    assert_eq!((header.pixel_width, header.pixel_height), (8, 8));
    assert_eq!((header.pixel_depth, header.layer_count), (0, 0));
    assert_eq!((header.face_count, header.level_count), (6, 3));
    assert_eq!(
        (header.type_size, header.supercompression_scheme),
        (2, None)
    );
    assert_eq!(reader.color_model(), Some(ColorModel::RGBSDA));
    assert_eq!(reader.color_primaries(), Some(ColorPrimaries::BT709));
    assert_eq!(reader.transfer_function(), Some(TransferFunction::Linear));
    assert_eq!(reader.is_alpha_premultiplied(), Some(false));
    let values: Vec<_> = reader.key_value_data().collect();
    let writer = concat!("gpugi ", env!("CARGO_PKG_VERSION"), "\0");
    assert_eq!(
        values,
        [
            ("KTXorientation", &b"rd\0"[..]),
            ("KTXwriter", writer.as_bytes())
        ]
    );
    let levels: Vec<_> = reader.levels().collect();
    assert_eq!(levels.len(), 3);
    for (level, expected) in levels.iter().zip(&cube.levels) {
        assert!(level.data == bytemuck::cast_slice::<_, u8>(expected));
        assert_eq!(level.uncompressed_byte_length, level.data.len() as u64);
        let at = level.data.as_ptr() as usize - bytes.as_ptr() as usize;
        assert_eq!(at % 8, 0, "a level lies at a multiple of a texel");
    }
    // The coarsest level comes first, and nothing follows the finest.
    assert!(levels[2].data.as_ptr() < levels[0].data.as_ptr());
    assert!(bytes.ends_with(levels[0].data));
}

#[test]
fn a_3d_texture_reads_back() {
    let flat = texture([3, 8], 1, 1);
    let solid = HalfTexture {
        size: [3, 2],
        depth: 4,
        ..flat
    };
    let bytes = saved("solid", &solid).unwrap();
    let reader = Reader::new(&bytes).unwrap();
    let header = reader.header();
    let size = (header.pixel_width, header.pixel_height, header.pixel_depth);
    assert_eq!(size, (3, 2, 4));
    assert_eq!((header.layer_count, header.face_count), (0, 1));
    let level = reader.levels().next().unwrap();
    assert!(level.data == bytemuck::cast_slice::<_, u8>(&solid.levels[0]));
}

/// The descriptor word by word, after Khronos Data Format Specification 1.4, section 5, and its example of four half
/// floats.
#[test]
fn the_descriptor_says_four_signed_half_floats() {
    let bytes = saved("descriptor", &texture([2, 2], 1, 1)).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let (at, length) = (word(48) as usize, word(52));
    let found: Vec<u32> = (0..length as usize / 4).map(|i| word(at + 4 * i)).collect();
    // Total size, vendor and type, size and version, flags/transfer/primaries/model, block size, bytes of planes.
    let mut expected = vec![92, 0, (88 << 16) | 2, 0x0001_0101, 0, 8, 0];
    for (i, channel) in [0, 1, 2, 15].into_iter().enumerate() {
        // Float and signed, channel; bits - 1; offset. Then position, and -1 to 1.
        let qualifiers = ((0xC0 | channel) << 24) | (15 << 16) | (16 * i as u32);
        expected.extend([qualifiers, 0, 0xBF80_0000, 0x3F80_0000]);
    }
    assert_eq!(found, expected);
}

#[test]
fn a_table_is_an_image_that_gpugi_reads() {
    let table = texture([4, 2], 1, 1);
    let bytes = saved("table", &table).unwrap();
    let image = decode_radiance("table", &bytes, &Limits::default()).unwrap();
    let Pixels::Rgba32Float(values) = image.pixels else {
        panic!("floats")
    };
    for (found, expected) in values.chunks(4).zip(&table.levels[0]) {
        // Radiance is not negative.
        let expected = expected.map(|value| value.to_f32().max(0.0));
        assert_eq!(found, expected);
    }
}

#[test]
fn levels_that_do_not_fit_are_refused() {
    let fine = texture([4, 4], 6, 3);
    let broken = [
        HalfTexture {
            levels: Vec::new(),
            ..fine.clone()
        },
        HalfTexture {
            faces: 5,
            ..fine.clone()
        },
        HalfTexture {
            size: [4, 3],
            ..fine.clone()
        },
        HalfTexture {
            depth: 2,
            ..fine.clone()
        },
        HalfTexture {
            size: [0, 0],
            ..fine.clone()
        },
        HalfTexture {
            levels: [&fine.levels[..], &fine.levels[2..]].concat(),
            ..fine.clone()
        },
        HalfTexture {
            levels: fine.levels[1..].to_vec(),
            ..fine.clone()
        },
    ];
    assert!(saved("fine", &fine).is_ok());
    for texture in broken {
        let refused = saved("broken", &texture).unwrap_err();
        assert_eq!(refused.kind(), std::io::ErrorKind::InvalidInput);
        assert!(refused.to_string().contains("texels"), "{refused}");
    }
}
