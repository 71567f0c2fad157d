//! Basis Universal textures.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use gpugi_scene::image::decode_color;
use gpugi_scene::{Image, Limits, Pixels};

pub const WIDTH: u32 = 16;
const HEIGHT: u32 = 12;
/// A ramp of 16 by x, one of 20 by y, and 128, as the Basis Universal encoder 2.1 writes it: ETC1S with BasisLZ.
const ETC1S: &str = include_str!("basis/etc1s.base64");
/// The same as UASTC with Zstandard.
pub const UASTC: &str = include_str!("basis/uastc.base64");

pub fn file(text: &str) -> Vec<u8> {
    BASE64_STANDARD.decode(text.replace('\n', "")).unwrap()
}

fn read(bytes: &[u8]) -> Result<Image, String> {
    let image = decode_color("a.ktx2", bytes, &Limits::default());
    image.map_err(|error| error.to_string())
}

/// ETC1S has one colour and four shades of it per block, so its texels are far from a ramp of two colours; the means of blocks
/// are near.
#[test]
fn texels_are_near_those_that_were_encoded() {
    for (text, of_texels, of_blocks) in [(ETC1S, 50.0, 8.0), (UASTC, 6.0, 2.0)] {
        let image = read(&file(text)).unwrap();
        assert_eq!([image.width, image.height], [WIDTH, HEIGHT]);
        let Pixels::Rgba8(texels) = &image.pixels else {
            panic!("bytes");
        };
        let mut most = 0.0_f32;
        let mut blocks = [[0.0_f32; 4]; (WIDTH * HEIGHT / 16) as usize];
        for (at, texel) in texels.chunks(4).enumerate() {
            let (x, y) = (at as u32 % WIDTH, at as u32 / WIDTH);
            let block = &mut blocks[(y / 4 * (WIDTH / 4) + x / 4) as usize];
            let expected = [x * 16, y * 20, 128, 255].map(|value| value as f32);
            for channel in 0..4 {
                let difference = f32::from(texel[channel]) - expected[channel];
                most = most.max(difference.abs());
                block[channel] += difference / 16.0;
            }
        }
        let means = blocks
            .iter()
            .flatten()
            .fold(0.0, |most, mean| mean.abs().max(most));
        println!("{most}, of blocks {means}");
        assert!(most <= of_texels && means <= of_blocks);
    }
}

/// Whatever a byte of the file says, it is an image or an error.
#[test]
fn damage_is_an_error_or_an_image() {
    for text in [ETC1S, UASTC] {
        let whole = file(text);
        let mut refused = 0;
        for at in 12..whole.len() {
            for value in [0, 1, 0x7f, 0xff] {
                let mut damaged = whole.clone();
                damaged[at] = value;
                refused += u32::from(read(&damaged).is_err());
            }
        }
        assert!(refused > 100, "{refused}");
        for length in 0..whole.len() {
            assert!(read(&whole[..length]).is_err(), "{length}");
        }
    }
}
