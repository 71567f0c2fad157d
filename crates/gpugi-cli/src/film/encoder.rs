//! What becomes of a film's frames: a folder of PNGs, an animated WebP, or a film by ffmpeg.

use std::ffi::OsString;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context, bail, ensure};
use gpugi_scene::image::replace_file;
use webp_animation::{EncoderOptions, EncodingConfig};

use crate::Usage;
use crate::output::{check_folders, frame_path, make_folder, write_png};

/// What a film is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    /// A folder of PNGs.
    Folder,
    /// Animated WebP.
    WebP,
    /// H.264 in MP4.
    Mp4,
    /// VP9 in WebM.
    WebM,
}

/// Largest side of a WebP (pixels).
const WEBP_SIDE: u32 = 16_383;
/// Quality, if no other is asked for.
const QUALITY: u8 = 75;

/// A film that is to be written.
#[derive(Debug)]
pub struct Output {
    path: PathBuf,
    format: Format,
    /// Width and height (pixels).
    size: [u32; 2],
    /// Frames per second.
    fps: f64,
    /// 0 to 100.
    quality: u8,
}

impl Output {
    /// A film at `path`, whose name says the format.
    ///
    /// # Errors
    /// [`Usage`] if the name says none, or the format has no such size or no quality.
    pub fn new(path: &Path, size: [u32; 2], fps: f64, quality: Option<u8>) -> anyhow::Result<Self> {
        let name = path.display();
        let is_folder = path.to_string_lossy().ends_with(std::path::is_separator);
        let extension = path.extension().filter(|_| !is_folder);
        let extension = extension.map(|extension| extension.to_string_lossy().to_lowercase());
        let format = match extension.as_deref() {
            None => Format::Folder,
            Some("webp") => Format::WebP,
            Some("mp4") => Format::Mp4,
            Some("webm") => Format::WebM,
            Some(_) => {
                return Err(Usage(format!(
                    "-o {name}: the name must end in .webp, .mp4 or .webm, or in / for a folder of PNGs"
                ))
                .into());
            }
        };
        let refused = match format {
            Format::Folder if quality.is_some() => Some("--quality: PNGs lose nothing".to_owned()),
            Format::WebP if size.iter().any(|&side| side > WEBP_SIDE) => Some(format!(
                "--size {}x{}: a .webp has at most {WEBP_SIDE} pixels a side",
                size[0], size[1]
            )),
            Format::Mp4 | Format::WebM if size.iter().any(|side| side % 2 != 0) => Some(format!(
                "--size {}x{}: films have even sides, because pixels share colours in pairs",
                size[0], size[1]
            )),
            _ => None,
        };
        if let Some(reason) = refused {
            return Err(Usage(reason).into());
        }
        Ok(Self {
            path: path.to_owned(),
            format,
            size,
            fps,
            quality: quality.unwrap_or(QUALITY),
        })
    }

    /// Whether frames become files of a folder.
    pub fn is_folder(&self) -> bool {
        matches!(self.format, Format::Folder)
    }

    /// Looks whether frames can be written, before hours are spent on them. Makes the folder, which may hold no more than
    /// `frames` of an earlier film, if they are known.
    ///
    /// # Errors
    /// What is missing.
    pub fn check(&self, frames: Option<u32>) -> anyhow::Result<()> {
        let folder = match self.format {
            Format::Folder => {
                make_folder(&self.path)?;
                let next = frames.map(|frames| frame_path(&self.path, frames));
                if let Some(next) = next.filter(|next| next.exists()) {
                    bail!(
                        "{} is of a longer film: remove that one, or name another folder",
                        next.display()
                    );
                }
                self.path.clone()
            }
            Format::WebP | Format::Mp4 | Format::WebM => {
                check_folders([self.path.as_path()])?;
                ensure!(!self.path.is_dir(), "{} is a folder", self.path.display());
                self.path.with_file_name("")
            }
        };
        let probe = folder.join(format!(".gpugi-{}.tmp", std::process::id()));
        File::create_new(&probe)
            .and_then(|_| std::fs::remove_file(&probe))
            .with_context(|| format!("{}: cannot be written", self.path.display()))?;
        match self.format {
            Format::Folder | Format::WebP => Ok(()),
            Format::Mp4 | Format::WebM => self.check_ffmpeg(),
        }
    }

    /// Looks whether there is an ffmpeg that makes films of this format.
    fn check_ffmpeg(&self) -> anyhow::Result<()> {
        let path = self.path.display();
        let codec = self.codec();
        let listed = Command::new(FFMPEG)
            .args(["-hide_banner", "-encoders"])
            .output();
        let listed = listed.with_context(|| {
            format!(
                "{path}: this takes ffmpeg, which does not run; install it (such as by apt install ffmpeg, \
                 brew install ffmpeg or winget install ffmpeg), or write a .webp or a folder, which need no other program"
            )
        })?;
        let listed = String::from_utf8_lossy(&listed.stdout);
        ensure!(
            listed.split_whitespace().any(|word| word == codec),
            "{path}: this takes an ffmpeg with the encoder {codec}, which the installed one lacks; \
             a .webp or a folder needs no other program"
        );
        Ok(())
    }

    /// The encoder, by ffmpeg's name.
    fn codec(&self) -> &'static str {
        match self.format {
            Format::WebM => "libvpx-vp9",
            Format::Folder | Format::WebP | Format::Mp4 => "libx264",
        }
    }

    /// Begins to write. `first`: the number of the first frame.
    ///
    /// # Errors
    /// Why it cannot.
    pub fn begin(&self, first: u32) -> anyhow::Result<Box<dyn Encoder>> {
        Ok(match self.format {
            Format::Folder => Box::new(Folder {
                folder: self.path.clone(),
                size: self.size,
                next: first,
            }),
            Format::WebP => Box::new(WebP::new(self)?),
            Format::Mp4 | Format::WebM => Box::new(Ffmpeg::new(self)?),
        })
    }
}

/// Writes a film. One that is dropped before it is finished leaves no file of its own, but for the PNGs of a folder.
pub trait Encoder {
    /// Adds a frame: 8-bit sRGB, RGBA.
    ///
    /// # Errors
    /// Why it is not written.
    fn add(&mut self, rgba: &[u8]) -> anyhow::Result<()>;

    /// Ends the film. Only then does it take the place of a file of its name.
    ///
    /// # Errors
    /// Why it is not written.
    fn finish(self: Box<Self>) -> anyhow::Result<()>;
}

struct Folder {
    folder: PathBuf,
    size: [u32; 2],
    /// Number of the next frame.
    next: u32,
}

impl Encoder for Folder {
    fn add(&mut self, rgba: &[u8]) -> anyhow::Result<()> {
        write_png(&frame_path(&self.folder, self.next), self.size, rgba)?;
        self.next += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> anyhow::Result<()> {
        Ok(())
    }
}

/// Holds the encoded frames until the end, because the file begins with what is known then.
struct WebP {
    encoder: webp_animation::Encoder,
    path: PathBuf,
    fps: f64,
    frames: u32,
}

impl WebP {
    fn new(output: &Output) -> anyhow::Result<Self> {
        let options = EncoderOptions {
            encoding_config: Some(EncodingConfig::new_lossy(output.quality.into())),
            ..Default::default()
        };
        let size = output.size.into();
        Ok(Self {
            encoder: webp_animation::Encoder::new_with_options(size, options)?,
            path: output.path.clone(),
            fps: output.fps,
            frames: 0,
        })
    }

    /// When the next frame begins (ms).
    fn time(&self) -> i32 {
        (f64::from(self.frames) * 1000.0 / self.fps).round() as i32
    }
}

impl Encoder for WebP {
    fn add(&mut self, rgba: &[u8]) -> anyhow::Result<()> {
        self.encoder.add_frame(rgba, self.time())?;
        self.frames += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> anyhow::Result<()> {
        let end = self.time();
        let film = self.encoder.finalize(end)?;
        replace_file(&self.path, |file| file.write_all(&film))
            .with_context(|| format!("{}: cannot be written", self.path.display()))
    }
}

/// The program.
const FFMPEG: &str = "ffmpeg";

/// Gets raw frames on its standard input, and writes a temporary file.
struct Ffmpeg {
    process: Child,
    temporary: PathBuf,
    path: PathBuf,
}

impl Ffmpeg {
    fn new(output: &Output) -> anyhow::Result<Self> {
        let name = output
            .path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy();
        let temporary = format!(".{name}.{}.tmp", std::process::id());
        let temporary = output.path.with_file_name(temporary);
        let process = command(output, &temporary).spawn().context(FFMPEG)?;
        Ok(Self {
            process,
            temporary,
            path: output.path.clone(),
        })
    }

    /// Waits for its end.
    fn end(&mut self) -> anyhow::Result<()> {
        drop(self.process.stdin.take());
        let status = self.process.wait().context(FFMPEG)?;
        if !status.success() {
            bail!(
                "{}: ffmpeg failed ({status}); it says why above",
                self.path.display()
            );
        }
        Ok(())
    }
}

impl Encoder for Ffmpeg {
    fn add(&mut self, rgba: &[u8]) -> anyhow::Result<()> {
        let input = self.process.stdin.as_mut().context(FFMPEG)?;
        let written = input.write_all(rgba);
        if written.is_err() {
            // It reads no more. Why, is said by its end.
            self.end()?;
        }
        written.with_context(|| format!("{}: ffmpeg takes no more frames", self.path.display()))
    }

    fn finish(mut self: Box<Self>) -> anyhow::Result<()> {
        self.end()?;
        std::fs::rename(&self.temporary, &self.path)
            .with_context(|| format!("{}: cannot be written", self.path.display()))
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        // Both fail if it has finished.
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_file(&self.temporary);
    }
}

/// ffmpeg, from raw frames to a film that everything plays: 8 bits, half the colours' resolution, Rec. 709 for pictures
/// and for their conversion, and what players look for first at the file's beginning.
fn command(output: &Output, temporary: &Path) -> Command {
    let mut command = Command::new(FFMPEG);
    let [width, height] = output.size;
    let (size, fps) = (format!("{width}x{height}"), output.fps.to_string());
    command.args(["-hide_banner", "-loglevel", "error", "-y"]);
    command.args([
        "-f",
        "rawvideo",
        "-pixel_format",
        "rgba",
        "-video_size",
        &size,
    ]);
    command.args(["-framerate", &fps, "-i", "pipe:0"]);
    command.args(["-vf", "scale=out_color_matrix=bt709:out_range=tv"]);
    command.args([
        "-pix_fmt",
        "yuv420p",
        "-color_range",
        "tv",
        "-colorspace",
        "bt709",
    ]);
    command.args(["-color_primaries", "bt709", "-color_trc", "bt709"]);
    let codec = output.codec();
    command.args(["-c:v", codec]);
    // Their scales of quality: lower is better. By default 18 and 30, which are hard to tell from the frames.
    let coarseness = |worst: f32| {
        (worst - 0.4 * f32::from(output.quality))
            .round()
            .to_string()
    };
    match output.format {
        Format::WebM => {
            command.args(["-crf", &coarseness(60.0), "-b:v", "0", "-row-mt", "1"]);
            command.args(["-f", "webm"]);
        }
        Format::Folder | Format::WebP | Format::Mp4 => {
            command.args(["-crf", &coarseness(48.0), "-movflags", "+faststart"]);
            command.args(["-f", "mp4"]);
        }
    }
    // Not a name in which ffmpeg sees a protocol or an option.
    let mut file = OsString::from("file:");
    file.push(temporary);
    command
        .arg(file)
        .stdin(Stdio::piped())
        .stdout(Stdio::null());
    // Ctrl-C is for this program, which then ends the film.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    #[cfg(windows)]
    std::os::windows::process::CommandExt::creation_flags(&mut command, NEW_PROCESS_GROUP);
    command
}

/// `CREATE_NEW_PROCESS_GROUP` of Windows.
#[cfg(windows)]
const NEW_PROCESS_GROUP: u32 = 0x200;
