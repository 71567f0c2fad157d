//! OpenEXR of every kind decodes to the texels that another decoder finds.

use std::io::Cursor;

use exr::meta::attribute::{Chromaticities, EnvironmentMap};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image as ExrImage,
    ImageAttributes, IntegerBounds, Layer, LayerAttributes, LineOrder, SmallVec, Vec2,
    WritableImage, f16,
};
use gpugi_scene::image::decode_radiance;
use gpugi_scene::{Limits, Pixels};
use image::DynamicImage;
use image::codecs::openexr::OpenExrDecoder;

const COMPRESSIONS: [Compression; 10] = [
    Compression::Uncompressed,
    Compression::RLE,
    Compression::ZIP1,
    Compression::ZIP16,
    Compression::PIZ,
    Compression::PXR24,
    Compression::B44,
    Compression::B44A,
    Compression::DWAA(None),
    Compression::DWAB(None),
];
/// Neither a multiple of the blocks of any compression, nor of tiles.
const WIDTH: usize = 45;
const HEIGHT: usize = 37;

#[derive(Clone, Copy, Debug)]
enum Kind {
    Half,
    Float,
    Integer,
}

/// Smooth in x and noisy in y, so that blocks compress, but not to nothing.
fn samples(kind: Kind, seed: usize) -> FlatSamples {
    let value = |at: usize| {
        let (x, y) = (at % WIDTH, at / WIDTH);
        x as f32 * 0.25 + ((y * 7 + seed) % 5) as f32 + 0.5
    };
    let values = (0..WIDTH * HEIGHT).map(value);
    match kind {
        Kind::Half => FlatSamples::F16(values.map(f16::from_f32).collect()),
        Kind::Float => FlatSamples::F32(values.collect()),
        Kind::Integer => FlatSamples::U32(values.map(|value| value as u32 * 1000).collect()),
    }
}

/// A layer with channels beside red, green and blue, of other types, before and between them.
fn layer(
    kind: Kind,
    encoding: Encoding,
    attributes: LayerAttributes,
) -> Layer<AnyChannels<FlatSamples>> {
    let other = match kind {
        Kind::Half => Kind::Float,
        _ => Kind::Half,
    };
    let channels = [
        ("A", other),
        ("B", kind),
        ("G", kind),
        ("N", other),
        ("R", kind),
        ("Z", other),
    ];
    let channels = channels.iter().enumerate();
    let channels: SmallVec<_> = channels
        .map(|(seed, &(name, kind))| AnyChannel::new(name, samples(kind, seed)))
        .collect();
    Layer::new(
        (WIDTH, HEIGHT),
        attributes,
        encoding,
        AnyChannels::sort(channels),
    )
}

/// A file of these layers, or `None` where the writer has no such compression.
fn written(
    layers: impl IntoIterator<Item = Layer<AnyChannels<FlatSamples>>>,
    display: IntegerBounds,
) -> Option<Vec<u8>> {
    let layers: SmallVec<_> = layers.into_iter().collect();
    let image = ExrImage::from_layers(ImageAttributes::new(display), layers);
    let mut bytes = Cursor::new(Vec::new());
    let written = image.write().non_parallel().to_buffered(&mut bytes);
    written.ok().map(|()| bytes.into_inner())
}

fn encoding(compression: Compression, blocks: Blocks) -> Encoding {
    Encoding {
        compression,
        blocks,
        line_order: LineOrder::Increasing,
    }
}

/// Asserts that gpugi reads every texel as the image crate does.
#[track_caller]
fn assert_same(bytes: &[u8], case: &str) {
    let decoder = OpenExrDecoder::with_alpha_preference(Cursor::new(bytes), Some(false));
    let expected = decoder.and_then(DynamicImage::from_decoder);
    let expected = expected.unwrap_or_else(|error| panic!("{case}: {error}"));
    let found = decode_radiance("a.exr", bytes, &Limits::default());
    let found = found.unwrap_or_else(|error| panic!("{case}: {error}"));
    assert_eq!(
        (found.width, found.height),
        (expected.width(), expected.height()),
        "{case}"
    );
    let Pixels::Rgba32Float(found) = found.pixels else {
        panic!("{case}: radiance is floats");
    };
    let expected = expected.into_rgba32f().into_raw();
    assert!(
        expected.iter().any(|&value| value > 1.0),
        "{case} shows nothing"
    );
    assert!(found == expected, "{case}");
}

#[test]
fn every_compression_in_lines_and_tiles_of_every_type() {
    let display = IntegerBounds::from_dimensions((WIDTH, HEIGHT));
    let mut read = 0;
    for compression in COMPRESSIONS {
        for blocks in [
            Blocks::ScanLines,
            Blocks::Tiles(Vec2(16, 9)),
            Blocks::Tiles(Vec2(64, 64)),
        ] {
            for kind in [Kind::Half, Kind::Float, Kind::Integer] {
                let layer = layer(
                    kind,
                    encoding(compression, blocks),
                    LayerAttributes::named("a"),
                );
                if let Some(bytes) = written([layer], display) {
                    assert_same(&bytes, &format!("{compression}, {blocks:?}, {kind:?}"));
                    read += 1;
                }
            }
        }
    }
    assert_eq!(read, 10 * 3 * 3);
}

/// Texels that are stored but not shown are left out; those that are shown but not stored are black.
#[test]
fn windows_that_differ() {
    for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 9))] {
        for (at, corner, size) in [
            ((0, 0), (-7, -3), (90, 60)),
            ((0, 0), (5, 11), (20, 15)),
            ((-30, -20), (-7, -3), (40, 8)),
            ((1000, -9000), (980, -9010), (30, 30)),
        ] {
            let mut attributes = LayerAttributes::named("a");
            attributes.layer_position = Vec2(at.0, at.1);
            let layer = layer(Kind::Half, encoding(Compression::ZIP16, blocks), attributes);
            let bytes = written([layer], IntegerBounds::new(corner, size)).unwrap();
            assert_same(&bytes, &format!("{blocks:?}, {at:?}, {corner:?}, {size:?}"));
        }
    }
}

/// The first part with red, green and blue is the picture.
#[test]
fn files_of_several_parts() {
    let display = IntegerBounds::from_dimensions((WIDTH, HEIGHT));
    let encoding = encoding(Compression::PIZ, Blocks::Tiles(Vec2(16, 9)));
    let mut depth = layer(Kind::Half, encoding, LayerAttributes::named("depth"));
    depth
        .channel_data
        .list
        .retain(|channel| channel.name == *"Z");
    let picture = layer(Kind::Half, encoding, LayerAttributes::named("picture"));
    let mut other = layer(Kind::Float, encoding, LayerAttributes::named("other"));
    other.encoding.compression = Compression::RLE;
    let bytes = written([depth, picture, other], display).unwrap();
    assert_same(&bytes, "three parts");
}

/// A file whose channels hold these values everywhere.
fn constant(channels: &[(&str, f32)], attributes: ImageAttributes) -> Vec<u8> {
    let texels = WIDTH * HEIGHT;
    let channel =
        |&(name, value): &(&str, f32)| AnyChannel::new(name, FlatSamples::F32(vec![value; texels]));
    let layer = Layer::new(
        (WIDTH, HEIGHT),
        LayerAttributes::named(""),
        encoding(Compression::ZIP16, Blocks::ScanLines),
        AnyChannels::sort(channels.iter().map(channel).collect()),
    );
    let mut bytes = Cursor::new(Vec::new());
    let image = ExrImage::new(attributes, layer);
    let written = image.write().non_parallel().to_buffered(&mut bytes);
    written.expect("a file");
    bytes.into_inner()
}

fn shown() -> ImageAttributes {
    ImageAttributes::new(IntegerBounds::from_dimensions((WIDTH, HEIGHT)))
}

/// The colour of a file that has the same one everywhere, or why it cannot be read.
fn color(bytes: &[u8]) -> Result<[f32; 3], String> {
    let image = decode_radiance("a.exr", bytes, &Limits::default());
    let image = image.map_err(|error| error.to_string())?;
    let Pixels::Rgba32Float(texels) = image.pixels else {
        panic!("radiance is floats");
    };
    let texels = texels.as_chunks::<4>().0;
    assert!(texels.iter().all(|texel| *texel == texels[0]));
    let [r, g, b, alpha] = texels[0];
    assert_eq!(alpha, 1.0);
    Ok([r, g, b])
}

#[test]
fn grey_is_read() {
    for channels in [
        &[("Y", 0.5)][..],
        &[("A", 1.0), ("Y", 0.5)],
        &[("Y", 0.5), ("Z", 3.0)],
    ] {
        assert_eq!(color(&constant(channels, shown())), Ok([0.5; 3]));
    }
}

#[test]
fn a_layer_of_colour_is_read() {
    let layer = |name: &str, values: [f32; 3]| {
        let channels = ["R", "G", "B"].into_iter().zip(values);
        let channels = channels.map(|(channel, value)| (format!("{name}.{channel}"), value));
        channels.collect::<Vec<(String, f32)>>()
    };
    let read = |layers: &[Vec<(String, f32)>]| {
        let channels = layers.iter().flatten();
        let channels: Vec<_> = channels.map(|(name, value)| (&name[..], *value)).collect();
        color(&constant(&channels, shown()))
    };
    let combined = layer("ViewLayer.Combined", [1.0, 2.0, 3.0]);
    let depth = vec![("ViewLayer.Depth.Z".to_owned(), 9.0)];
    let albedo = layer("ViewLayer.Albedo", [0.5; 3]);
    assert_eq!(
        read(&[combined.clone(), depth.clone()]),
        Ok([1.0, 2.0, 3.0])
    );
    assert_eq!(read(&[albedo.clone(), combined]), Ok([1.0, 2.0, 3.0]));
    let other = layer("ViewLayer.Direct", [0.5; 3]);
    let error = read(&[albedo, other]).unwrap_err();
    let several = "several layers have colours (ViewLayer.Albedo, ViewLayer.Direct)";
    assert!(error.contains(several), "{error}");
    let error = read(&[depth]).unwrap_err();
    assert!(error.contains("no channels R, G and B, nor Y"), "{error}");
    assert!(error.contains("ViewLayer.Depth.Z"), "{error}");
}

#[test]
fn chroma_is_named() {
    let chroma = constant(&[("BY", 0.0), ("RY", 0.0), ("Y", 0.5)], shown());
    let error = color(&chroma).unwrap_err();
    assert!(
        error.contains("luminance and chroma (Y, RY, BY)"),
        "{error}"
    );
}

#[test]
fn other_primaries_become_those_of_rec_709() {
    let read = |values: [f32; 3], chromaticities: [[f32; 2]; 4]| {
        let [red, green, blue, white] = chromaticities.map(|[x, y]| Vec2(x, y));
        let mut attributes = shown();
        attributes.chromaticities = Some(Chromaticities {
            red,
            green,
            blue,
            white,
        });
        let [r, g, b] = values;
        color(&constant(&[("R", r), ("G", g), ("B", b)], attributes)).unwrap()
    };
    let close = |found: [f32; 3], wanted: [f32; 3]| {
        let differences = found.iter().zip(wanted).map(|(a, b)| (a - b).abs());
        assert!(differences.fold(0.0, f32::max) < 1e-3, "{found:?}");
    };
    let xyz = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0 / 3.0; 2]];
    close(read([0.4753, 0.5, 0.5445], xyz), [0.5; 3]);
    let rec_2020 = [
        [0.708, 0.292],
        [0.17, 0.797],
        [0.131, 0.046],
        [0.3127, 0.329],
    ];
    close(read([0.6274, 0.0691, 0.0164], rec_2020), [1.0, 0.0, 0.0]);
    let rec_709 = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]];
    assert_eq!(read([0.1, 0.2, 0.3], rec_709), [0.1, 0.2, 0.3]);
    // They make no colours.
    assert_eq!(read([0.1, 0.2, 0.3], [[0.0; 2]; 4]), [0.1, 0.2, 0.3]);
}

#[test]
fn a_cube_is_named() {
    let mut layer = layer(
        Kind::Half,
        encoding(Compression::ZIP16, Blocks::ScanLines),
        LayerAttributes::named(""),
    );
    let display = IntegerBounds::from_dimensions((WIDTH, HEIGHT));
    layer.attributes.environment_map = Some(EnvironmentMap::LatitudeLongitude);
    assert_same(&written([layer.clone()], display).unwrap(), "latlong");
    layer.attributes.environment_map = Some(EnvironmentMap::Cube);
    let error = color(&written([layer], display).unwrap()).unwrap_err();
    assert!(
        error.contains("attribute envmap: cube maps are not read"),
        "{error}"
    );
}

/// Tiles, other compressions and other orders are files that some programs refuse.
#[test]
fn written_files_are_scan_lines_from_the_top() {
    let rgb: Vec<f32> = (0..3 * WIDTH * HEIGHT).map(|value| value as f32).collect();
    let [width, height] = [WIDTH, HEIGHT].map(|side| side as u32);
    let path =
        |name: &str| std::env::temp_dir().join(format!("gpugi-{name}-{}.exr", std::process::id()));
    let [plain, layers] = ["plain", "layers"].map(path);
    gpugi_scene::image::save_exr(&plain, width, height, &rgb).unwrap();
    let depth = (
        "ViewLayer.Depth.Z".to_owned(),
        rgb[..WIDTH * HEIGHT].to_vec(),
    );
    gpugi_scene::image::save_exr_layers(&layers, width, height, vec![depth]).unwrap();
    let files = [&plain, &layers].map(|path| {
        let bytes = std::fs::read(path).unwrap();
        std::fs::remove_file(path).unwrap();
        bytes
    });
    for bytes in &files {
        let meta = exr::meta::MetaData::read_from_buffered(bytes.as_slice(), true).unwrap();
        let header = &meta.headers[0];
        assert_eq!(header.blocks, exr::meta::BlockDescription::ScanLines);
        assert_eq!(header.compression, Compression::ZIP16);
        assert_eq!(header.line_order, LineOrder::Increasing);
    }
    let read = decode_radiance("plain.exr", &files[0], &Limits::default()).unwrap();
    let Pixels::Rgba32Float(read) = read.pixels else {
        panic!("{:?}", read.pixels);
    };
    let found = read.chunks(4).flat_map(|texel| &texel[..3]);
    assert!(found.eq(&rgb));
}
