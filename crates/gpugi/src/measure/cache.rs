//! Cache of path-traced references, kept in a folder between measurements. A file is named by the hash of what it shows
//! and, unless it is pinned, of the path tracer that rendered it. It appears complete or not at all, and is trusted only
//! if its checksum is correct. Files may be deleted at any time.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::reference::Settings;
use crate::shader;

/// The first bytes of a file; the digit is the format version.
const MAGIC: &[u8; 16] = b"gpugi reference2";
/// Size of the checksum (bytes): BLAKE3 of everything after it.
const CHECKSUM: usize = 32;
/// Maximum size of a header (bytes).
const MOST_HEADER: u64 = 1 << 16;

/// Increase this number when a change to the path tracer's host code changes its output: which lights there are, how
/// they emit, what the geometry is. Changes to its shaders are detected automatically.
const ALGORITHM: u32 = 3;

/// Everything that determines an image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Key {
    size: [u32; 2],
    /// What the image shows, as JSON.
    subject: String,
    /// Hash of the path tracer that renders it.
    tracer: String,
}

impl Key {
    /// The key of the path tracer's image with these settings. `digests` are those of the scene and of the camera.
    pub fn new(
        digests: [[u8; 32]; 2],
        size: [u32; 2],
        settings: &Settings,
        samples: u32,
        seed: u32,
    ) -> Self {
        let mut tracer = blake3::Hasher::new();
        tracer.update(&ALGORITHM.to_le_bytes());
        for shader in [
            shader!("paths.plan"),
            shader!("paths.trace"),
            shader!("paths.shade"),
            shader!("reference.resolve"),
            shader!("reference.photons.trace"),
            shader!("reference.photons.merging.follow"),
            shader!("reference.photons.merging.link"),
            shader!("reference.photons.resolve"),
            shader!("reference.noise"),
        ] {
            tracer.update(blake3::hash(shader.source.as_bytes()).as_bytes());
        }
        let [scene, camera] = digests.map(|digest| blake3::Hash::from_bytes(digest).to_string());
        let subject = serde_json::json!({
            "scene": scene,
            "camera": camera,
            "size": size,
            "settings": settings,
            "samples": samples,
            "seed": seed,
        })
        .to_string();
        Self {
            size,
            subject,
            tracer: tracer.finalize().to_string(),
        }
    }

    fn values(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1]) * 3
    }
}

/// An image, and how it was rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Linear radiance, three floats per pixel.
    pub radiance: Vec<f32>,
    /// Samples per pixel.
    pub samples: u32,
    /// Estimated relative mean squared error.
    pub rel_mse: f64,
    /// Render time (s).
    pub seconds: f64,
    /// The adapter that rendered it.
    pub adapter: String,
}

/// The header before the image, as JSON.
#[derive(Debug, Serialize, Deserialize)]
struct Header {
    subject: String,
    tracer: String,
    samples: u32,
    rel_mse: f64,
    seconds: f64,
    adapter: String,
}

/// A folder of references.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cache {
    folder: PathBuf,
    /// Whether references of another version of the path tracer are read, too.
    is_pinned: bool,
}

impl Cache {
    /// A cache in `folder`, which is created when the first reference is stored.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
            is_pinned: false,
        }
    }

    /// A cache whose references stay valid whatever becomes of the path tracer, as tests want them that keep references
    /// beside their code: a path tracer that changes its mind fails them.
    pub fn pinned(folder: impl Into<PathBuf>) -> Self {
        Self {
            is_pinned: true,
            ..Self::new(folder)
        }
    }

    fn path(&self, key: &Key) -> PathBuf {
        let mut name = blake3::Hasher::new();
        name.update(key.subject.as_bytes());
        if !self.is_pinned {
            name.update(key.tracer.as_bytes());
        }
        self.folder.join(format!("{}.reference", name.finalize()))
    }

    /// The image of `key`, if it is cached. The error says which file is damaged and how.
    pub fn read(&self, key: &Key) -> Result<Option<Entry>, String> {
        let path = self.path(key);
        let damaged = |how: &str| format!("{}: {how}", path.display());
        let cannot = |error: io::Error| damaged(&format!("cannot be read ({error})"));
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(cannot(error)),
        };
        // Read no more than a complete file contains, and one byte to detect excess.
        let prefix = (MAGIC.len() + CHECKSUM + 4) as u64;
        let most = prefix + MOST_HEADER + key.values() * 4;
        let mut bytes = Vec::new();
        file.take(most + 1)
            .read_to_end(&mut bytes)
            .map_err(cannot)?;
        let rest = bytes
            .strip_prefix(MAGIC)
            .ok_or_else(|| damaged("is no reference of this version"))?;
        let (checksum, content) = rest
            .split_first_chunk::<CHECKSUM>()
            .ok_or_else(|| damaged("is cut off"))?;
        if blake3::hash(content) != blake3::Hash::from_bytes(*checksum) {
            return Err(damaged("is damaged: its checksum is wrong"));
        }
        self.parse(key, content)
            .map(Some)
            .ok_or_else(|| damaged("does not hold what its name says"))
    }

    /// Stores an image.
    pub fn write(&self, key: &Key, entry: &Entry) -> io::Result<()> {
        let is_finite = |value: &f32| value.is_finite();
        if !(entry.rel_mse.is_finite() && entry.radiance.iter().all(is_finite)) {
            return Err(io::Error::other("it holds values that are not finite"));
        }
        std::fs::create_dir_all(&self.folder)?;
        let header = serde_json::to_string(&Header {
            subject: key.subject.clone(),
            tracer: key.tracer.clone(),
            samples: entry.samples,
            rel_mse: entry.rel_mse,
            seconds: entry.seconds,
            adapter: entry.adapter.clone(),
        })?;
        let mut content = (header.len() as u32).to_le_bytes().to_vec();
        content.extend(header.as_bytes());
        content.extend(entry.radiance.iter().flat_map(|value| value.to_le_bytes()));
        gpugi_scene::image::replace_file(&self.path(key), |file| {
            file.write_all(MAGIC)?;
            file.write_all(blake3::hash(&content).as_bytes())?;
            file.write_all(&content)
        })
    }

    /// Parses what follows the checksum. `None` if it is not the image of `key`.
    fn parse(&self, key: &Key, content: &[u8]) -> Option<Entry> {
        let (length, rest) = content.split_first_chunk::<4>()?;
        let (header, texels) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        let header: Header = serde_json::from_slice(header).ok()?;
        let (texels, odd) = texels.as_chunks::<4>();
        let radiance: Vec<f32> = texels.iter().copied().map(f32::from_le_bytes).collect();
        let is_right = header.subject == key.subject
            && (self.is_pinned || header.tracer == key.tracer)
            && odd.is_empty()
            && radiance.len() as u64 == key.values()
            && radiance.iter().all(|value| value.is_finite())
            && header.rel_mse >= 0.0
            && header.seconds >= 0.0;
        is_right.then_some(Entry {
            radiance,
            samples: header.samples,
            rel_mse: header.rel_mse,
            seconds: header.seconds,
            adapter: header.adapter,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(change: impl FnOnce(&mut Settings)) -> Key {
        let mut settings = Settings::default();
        change(&mut settings);
        Key::new([[1; 32], [2; 32]], [4, 2], &settings, 64, 0)
    }

    fn entry() -> Entry {
        Entry {
            radiance: (0..24).map(|value| value as f32 * 0.37).collect(),
            samples: 64,
            rel_mse: 1.0 / 3.0,
            seconds: 0.1,
            adapter: "a GPU".into(),
        }
    }

    /// An empty cache used by one test only.
    fn cache(name: &str) -> Cache {
        let name = format!("gpugi-cache-{name}-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::remove_dir_all(&folder).ok();
        Cache::new(folder)
    }

    #[test]
    fn what_is_kept_is_read_and_all_that_decides_it_counts() {
        let cache = cache("keys");
        let kept = key(|_| {});
        assert_eq!(cache.read(&kept), Ok(None));
        cache.write(&kept, &entry()).expect("kept");
        assert_eq!(cache.read(&kept), Ok(Some(entry())));
        let digests = [[1; 32], [2; 32]];
        let settings = Settings::default();
        for other in [
            key(|settings| settings.max_bounces = 3),
            key(|settings| settings.roulette_after = 3),
            key(|settings| settings.paths = "LE".into()),
            key(|settings| settings.lights = "area".into()),
            key(|settings| settings.noise = 1e-9),
            Key::new([[3; 32], [2; 32]], [4, 2], &settings, 64, 0),
            Key::new([[1; 32], [3; 32]], [4, 2], &settings, 64, 0),
            Key::new(digests, [2, 4], &settings, 64, 0),
            Key::new(digests, [4, 2], &settings, 65, 0),
            Key::new(digests, [4, 2], &settings, 64, 1),
        ] {
            assert_eq!(cache.read(&other), Ok(None), "{other:?}");
        }
        std::fs::remove_dir_all(&cache.folder).expect("removed");
    }

    #[test]
    fn only_pinned_references_outlive_their_path_tracer() {
        let by_another = |key: &Key| Key {
            tracer: "another".into(),
            ..key.clone()
        };
        let kept = key(|_| {});
        let own = cache("own");
        own.write(&by_another(&kept), &entry()).expect("kept");
        assert_eq!(own.read(&kept), Ok(None));
        let pinned = Cache::pinned(cache("pinned").folder);
        pinned.write(&by_another(&kept), &entry()).expect("kept");
        assert_eq!(pinned.read(&kept), Ok(Some(entry())));
        assert_eq!(
            pinned.read(&key(|settings| settings.max_bounces = 3)),
            Ok(None)
        );
        // A file under a name that is not its own.
        std::fs::rename(pinned.path(&kept), pinned.folder.join("other")).expect("renamed");
        std::fs::create_dir_all(&own.folder).expect("a folder");
        std::fs::copy(pinned.folder.join("other"), own.path(&kept)).expect("copied");
        assert!(own.read(&kept).is_err());
        for cache in [own, pinned] {
            std::fs::remove_dir_all(&cache.folder).expect("removed");
        }
    }

    #[test]
    fn damage_is_named_and_not_believed() {
        let cache = cache("damage");
        let kept = key(|_| {});
        cache.write(&kept, &entry()).expect("kept");
        let path = cache.path(&kept);
        let whole = std::fs::read(&path).expect("the file");
        let refused = |what: &str, bytes: &[u8]| {
            std::fs::write(&path, bytes).expect("the damage");
            let message = cache.read(&kept).expect_err(what);
            assert!(message.contains(&path.display().to_string()), "{message}");
        };
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 4;
            refused("a flipped bit", &bytes);
            refused("a file cut off", &whole[..at]);
        }
        refused("a longer file", &[&whole[..], &[0; 4]].concat());
        refused("a much longer file", &[&whole[..], &[0; 1 << 20]].concat());

        // The checksum is correct, but the content does not match the file name.
        let with_checksum = |content: &[u8]| {
            let checksum = blake3::hash(content);
            [MAGIC, &checksum.as_bytes()[..], content].concat()
        };
        let content = &whole[MAGIC.len() + CHECKSUM..];
        assert_eq!(with_checksum(content), whole);
        for (what, content) in [
            ("nothing", Vec::new()),
            ("an endless header", vec![255; 40]),
            ("a texel less", content[..content.len() - 4].to_vec()),
            ("half a texel", content[..content.len() - 2].to_vec()),
            ("a texel more", [content, &[0; 4]].concat()),
            (
                "a texel that is not a number",
                [&content[..content.len() - 4], &[255; 4]].concat(),
            ),
        ] {
            refused(what, &with_checksum(&content));
        }
        let other = key(|settings| settings.max_bounces = 3);
        cache.write(&other, &entry()).expect("kept");
        let others = std::fs::read(cache.path(&other)).expect("the file");
        refused("another reference", &others);

        // Non-finite values would be rejected on reading, so they are not stored.
        for spoil in [
            |entry: &mut Entry| entry.radiance[3] = f32::NAN,
            |entry: &mut Entry| entry.rel_mse = f64::INFINITY,
        ] {
            let mut entry = entry();
            spoil(&mut entry);
            assert!(cache.write(&kept, &entry).is_err());
        }
        std::fs::remove_dir_all(&cache.folder).expect("removed");
    }
}
