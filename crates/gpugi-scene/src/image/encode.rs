//! Writes image files. A file appears complete or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use image::codecs::{hdr::HdrEncoder, png::PngEncoder};
use image::{ExtendedColorType, ImageEncoder, Rgb};

/// Writes an 8-bit PNG with alpha. `rgba`: width x height x 4 sRGB values, row by row from the top.
pub fn save_png(path: &Path, width: u32, height: u32, rgba: &[u8]) -> io::Result<()> {
    replace_file(path, |file| write_png(file, width, height, rgba))
}

/// As [`save_png`], to anything that can be written.
pub fn write_png(file: impl Write, width: u32, height: u32, rgba: &[u8]) -> io::Result<()> {
    check_length(width, height, 4, rgba.len())?;
    PngEncoder::new(file)
        .write_image(rgba, width, height, ExtendedColorType::Rgba8)
        .map_err(io::Error::other)
}

/// Writes an OpenEXR file of 32-bit floats. `rgb`: width x height x 3 linear values, row by row from the top.
pub fn save_exr(path: &Path, width: u32, height: u32, rgb: &[f32]) -> io::Result<()> {
    replace_file(path, |file| write_exr(file, width, height, rgb))
}

/// As [`save_exr`], to anything that can be written.
pub fn write_exr(file: impl Write + Seek, width: u32, height: u32, rgb: &[f32]) -> io::Result<()> {
    check_length(width, height, 3, rgb.len())?;
    let channel = |(number, name): (usize, &str)| {
        let values = rgb.iter().skip(number).step_by(3);
        (name.to_owned(), values.copied().collect())
    };
    let channels = ["R", "G", "B"].into_iter().enumerate().map(channel);
    write_exr_channels(file, width, height, channels.collect())
}

/// Writes an OpenEXR file of 32-bit floats with any channels: names, such as `ViewLayer.Depth.Z`, and width x height
/// values each, row by row from the top.
pub fn save_exr_layers(
    path: &Path,
    width: u32,
    height: u32,
    channels: Vec<(String, Vec<f32>)>,
) -> io::Result<()> {
    replace_file(path, |file| {
        write_exr_channels(file, width, height, channels)
    })
}

/// Scan lines from the top, compressed by ZIP: tiles and other compressions are files that some programs refuse, such as
/// Babylon.js.
fn write_exr_channels(
    file: impl Write + Seek,
    width: u32,
    height: u32,
    channels: Vec<(String, Vec<f32>)>,
) -> io::Result<()> {
    use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, WritableImage};
    for (_, values) in &channels {
        check_length(width, height, 1, values.len())?;
    }
    let channels = channels.into_iter().map(|(name, values)| {
        AnyChannel::new(
            exr::prelude::Text::new_or_panic(name),
            FlatSamples::F32(values),
        )
    });
    let channels = AnyChannels::sort(channels.collect());
    let size = (width as usize, height as usize);
    let image = Image::from_encoded_channels(size, Encoding::SMALL_LOSSLESS, channels);
    image.write().to_buffered(file).map_err(io::Error::other)
}

/// Writes a Radiance HDR file, in which three 8-bit mantissas share an exponent. `rgb` as for [`save_exr`].
pub fn save_hdr(path: &Path, width: u32, height: u32, rgb: &[f32]) -> io::Result<()> {
    check_length(width, height, 3, rgb.len())?;
    let (texels, _) = rgb.as_chunks::<3>();
    let texels: Vec<_> = texels.iter().copied().map(Rgb).collect();
    replace_file(path, |file| {
        HdrEncoder::new(file)
            .encode(&texels, width as usize, height as usize)
            .map_err(io::Error::other)
    })
}

/// Writes to a temporary file in the same directory through `write`, then renames it to `path`, so that an existing
/// file at `path` survives a failure. Error messages name `path`.
pub fn replace_file(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    // Threads or processes that write the same file must not share the temporary one.
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let named =
        |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    let Some(name) = path.file_name() else {
        return Err(named(io::Error::new(
            io::ErrorKind::InvalidInput,
            "this is no file name",
        )));
    };
    let temporary = path.with_file_name(format!(
        ".{}.{}-{}.tmp",
        name.to_string_lossy(),
        std::process::id(),
        COUNTER.fetch_add(1, Ordering::Relaxed)
    ));
    let written = File::create_new(&temporary).and_then(|file| {
        let mut file = BufWriter::new(file);
        write(&mut file)?;
        file.flush()?;
        drop(file);
        std::fs::rename(&temporary, path)
    });
    written.map_err(|error| {
        let _ = std::fs::remove_file(&temporary);
        named(error)
    })
}

fn check_length(width: u32, height: u32, channels: u64, length: usize) -> io::Result<()> {
    if width == 0 || height == 0 || u64::from(width) * u64::from(height) * channels != length as u64
    {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            format!("{length} values are no {width} x {height} image of {channels} channels"),
        ));
    }
    Ok(())
}
