//! Radiance HDR as its programs write it.

use gpugi_scene::image::decode_radiance;
use gpugi_scene::{Limits, Pixels};

use crate::random::Random;

/// Width, height and colours of a file: `texels` after these lines.
fn read(lines: &str, texels: &[u8]) -> Result<(u32, u32, Vec<[f32; 3]>), String> {
    let bytes = [lines.as_bytes(), texels].concat();
    let image = decode_radiance("a.hdr", &bytes, &Limits::default());
    let image = image.map_err(|error| error.to_string())?;
    let Pixels::Rgba32Float(texels) = image.pixels else {
        panic!("radiance is floats");
    };
    let texels = texels.as_chunks::<4>().0.iter();
    let colors = texels.map(|&[r, g, b, alpha]| {
        assert_eq!(alpha, 1.0);
        [r, g, b]
    });
    Ok((image.width, image.height, colors.collect()))
}

/// One texel after these lines of a header.
fn one(lines: &str, texel: [u8; 4]) -> Result<[f32; 3], String> {
    let header = format!("{lines}\n\n-Y 1 +X 1\n");
    read(&header, &texel).map(|(_, _, colors)| colors[0])
}

/// Mantissa 128 with exponent 128 is 0.5.
const HALF: [u8; 4] = [128, 128, 128, 128];

#[test]
fn any_program_may_have_written_it() {
    for program in ["RADIANCE", "RGBE", "AUTOPANO", ""] {
        let lines = format!("#?{program}\n# a comment\nSOFTWARE=a=b\nFORMAT=32-bit_rle_rgbe");
        assert_eq!(one(&lines, HALF), Ok([0.5; 3]), "{program}");
    }
}

#[test]
fn exposures_are_undone() {
    let lines = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2.0\nEXPOSURE= 0.25";
    assert_eq!(one(lines, HALF), Ok([1.0; 3]));
    let lines = "#?RADIANCE\nEXPOSURE=2\nCOLORCORR=0.5 1 2\nCOLORCORR= 1 2 1";
    assert_eq!(one(lines, HALF), Ok([0.5, 0.125, 0.125]));
    for wrong in ["0", "-1", "nan", "x"] {
        let error = one(&format!("#?RADIANCE\nEXPOSURE={wrong}"), HALF).unwrap_err();
        assert!(error.contains("header: "), "{error}");
    }
}

#[test]
fn xyze_becomes_rgb() {
    let lines = "#?RADIANCE\nFORMAT=32-bit_rle_xyze";
    // The XYZ of white, D65, times 0.5.
    let color = one(lines, [122, 128, 139, 128]).unwrap();
    assert!(
        color.iter().all(|channel| (channel - 0.5).abs() < 6e-3),
        "{color:?}"
    );
    let error = one("#?RADIANCE\nFORMAT=16-bit", HALF).unwrap_err();
    assert!(error.contains("FORMAT: \"16-bit\""), "{error}");
}

#[test]
fn primaries_become_those_of_rec_709() {
    let lines = "#?RADIANCE\nPRIMARIES= .708 .292 .170 .797 .131 .046 .3127 .3290";
    let color = one(lines, HALF).unwrap();
    assert!(
        color.iter().all(|channel| (channel - 0.5).abs() < 1e-4),
        "{color:?}"
    );
    let [r, g, _] = one(lines, [128, 0, 0, 129]).unwrap();
    assert!((r - 1.6605).abs() < 1e-3 && g == 0.0, "{r} {g}");
}

#[test]
fn every_orientation() {
    let texel = |value: u8| [value, 0, 0, 136];
    // A picture of two rows: 1 2 3, 4 5 6.
    for (size, stored) in [
        ("-Y 2 +X 3", [1, 2, 3, 4, 5, 6]),
        ("-Y 2 -X 3", [3, 2, 1, 6, 5, 4]),
        ("+Y 2 +X 3", [4, 5, 6, 1, 2, 3]),
        ("+Y 2 -X 3", [6, 5, 4, 3, 2, 1]),
        ("+X 3 -Y 2", [1, 4, 2, 5, 3, 6]),
        ("+X 3 +Y 2", [4, 1, 5, 2, 6, 3]),
        ("-X 3 -Y 2", [3, 6, 2, 5, 1, 4]),
        ("-X 3 +Y 2", [6, 3, 5, 2, 4, 1]),
    ] {
        let header = format!("#?RADIANCE\n\n{size}\n");
        let (width, height, colors) = read(&header, stored.map(texel).as_flattened()).unwrap();
        assert_eq!((width, height), (3, 2), "{size}");
        let red: Vec<f32> = colors.iter().map(|color| color[0]).collect();
        assert_eq!(red, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "{size}");
    }
    for size in [
        "-Y 2 +Y 3",
        "-Y 2",
        "-Y 2 +X 3 +X 3",
        "-Z 2 +X 3",
        "-Y -2 +X 3",
    ] {
        let error = read(&format!("#?RADIANCE\n\n{size}\n"), &[]).unwrap_err();
        assert!(
            error.contains("is no size, such as -Y 512 +X 1024"),
            "{error}"
        );
    }
}

#[test]
fn lines_may_be_packed_in_both_ways() {
    // As today: a line of its length, then each channel in runs.
    let today = [
        &[2, 2, 0, 8][..],
        &[128 + 8, 128].repeat(3),
        &[128 + 8, 129],
    ]
    .concat();
    let (_, _, colors) = read("#?RADIANCE\n\n-Y 1 +X 8\n", &today).unwrap();
    assert_eq!(colors, [[1.0; 3]; 8]);
    // As before 1991: a texel, and how often it repeats.
    let before = [&HALF[..], &[1, 1, 1, 5], &[128, 0, 0, 129], &[1, 1, 1, 1]].concat();
    let (_, _, colors) = read("#?RADIANCE\n\n-Y 1 +X 8\n", &before).unwrap();
    assert_eq!(colors[..6], [[0.5; 3]; 6]);
    assert_eq!(colors[6..], [[1.0, 0.0, 0.0]; 2]);
}

#[test]
fn what_is_cut_short_is_an_error() {
    for bytes in [
        "#?",
        "#?RADIANCE\n",
        "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n",
    ] {
        let error = read(bytes, &[]).unwrap_err();
        assert!(error.contains("the file ends inside its header"), "{error}");
    }
    read("#?RADIANCE\n\n-Y 2 +X 8\n", &HALF).unwrap_err();
}

#[test]
fn damaged_files_never_panic() {
    let lines = "#?RGBE\nEXPOSURE=2\nPRIMARIES=.7 .3 .2 .7 .1 .1 .3 .3\nFORMAT=32-bit_rle_xyze\n\n+X 8 -Y 1\n";
    let file = [lines.as_bytes(), HALF.repeat(8).as_slice()].concat();
    let limits = Limits {
        image_bytes: 1 << 20,
        ..Limits::default()
    };
    let mut random = Random(3);
    for _ in 0..5000 {
        let _ = decode_radiance("a.hdr", &random.damage(&file), &limits);
    }
}
