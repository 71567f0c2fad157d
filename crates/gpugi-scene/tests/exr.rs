//! OpenEXR of every kind decodes to the texels that another decoder finds.

use std::io::Cursor;

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
