//! Pictures and views as files: in the working folder, or handed over by the browser.

use std::io::Cursor;

use gpugi_scene::image::{write_exr, write_png};

use crate::command::view_file;
use crate::session::Session;
use crate::task::Task;

/// A picture that is being written, and what is to be said about it.
pub type Saving = Task<Result<String, String>>;

/// What is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// The picture, as PNG.
    Picture,
    /// Its linear radiance, as EXR.
    Radiance,
    /// The view, as a file that opens it again.
    View,
}

/// Begins to write what is seen. `done` is called after its end.
///
/// # Errors
/// Why it cannot be read.
pub fn save(
    session: &Session,
    what: What,
    done: impl FnOnce() + Send + 'static,
) -> Result<Saving, String> {
    let renderer = &session.loaded().renderer;
    let [width, height] = renderer.size();
    Ok(match what {
        What::View => {
            let text = view_file(session);
            Task::start("view", done, move |_| async move {
                hand_over("json", text.as_bytes())
            })
        }
        What::Radiance => {
            let radiance = session.begin_radiance();
            let radiance = radiance.map_err(|error| error.to_string())?;
            Task::start("EXR", done, move |_| async move {
                let radiance = radiance.await.map_err(|error| error.to_string())?;
                let mut file = Cursor::new(Vec::new());
                let written = write_exr(&mut file, width, height, &radiance);
                written.map_err(|error| error.to_string())?;
                hand_over("exr", &file.into_inner())
            })
        }
        What::Picture => {
            let pixels = renderer.begin_pixels();
            let pixels = pixels.map_err(|error| error.to_string())?;
            Task::start("PNG", done, move |_| async move {
                let pixels = pixels.await.map_err(|error| error.to_string())?;
                let mut file = Vec::new();
                let written = write_png(&mut file, width, height, &pixels);
                written.map_err(|error| error.to_string())?;
                hand_over("png", &file)
            })
        }
    })
}

/// Writes a new file of the working folder.
#[cfg(not(target_arch = "wasm32"))]
fn hand_over(extension: &str, bytes: &[u8]) -> Result<String, String> {
    use std::io::Write;
    let path = (1..)
        .map(|number| std::path::PathBuf::from(format!("gpugi-{number}.{extension}")))
        .find(|path| !path.exists());
    let path = path.ok_or("the folder is full of pictures")?;
    let written = gpugi_scene::image::replace_file(&path, |file| file.write_all(bytes));
    written.map_err(|error| error.to_string())?;
    Ok(format!("{} is written", path.display()))
}

/// Downloads the file, which browsers number.
#[cfg(target_arch = "wasm32")]
fn hand_over(extension: &str, bytes: &[u8]) -> Result<String, String> {
    let name = format!("gpugi.{extension}");
    crate::browser::download(&name, bytes);
    Ok(format!("{name} is downloaded"))
}
