//! Bind groups, kept by the identity of what they bind, and small uniform buffers, kept by what they hold. So a pass
//! names what it reads and writes whenever it runs, and nobody else keeps either.

#[cfg(test)]
mod tests;

use std::hash::{Hash, Hasher};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use rustc_hash::{FxHashMap, FxHasher};

use super::shader::{Declared, is_linked_name};
use super::{Gpu, GpuError, HostBuffer};

/// What is unused for this many frames is dropped, so that it holds no memory that nobody else uses.
const PATIENCE: u64 = 8;
/// Before an allocation of so many bytes, what the present frame has not used yet is dropped: it may bind what the
/// allocation replaces.
const LARGE: u64 = 1 << 24;

/// A resource that a shader binds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Bound<'a> {
    /// A whole buffer.
    Buffer(&'a wgpu::Buffer),
    /// A view of a texture.
    View(&'a wgpu::TextureView),
    /// A sampler.
    Sampler(&'a wgpu::Sampler),
}

/// What can be bound.
pub trait Bind {
    /// The resource.
    fn bound(&self) -> Bound<'_>;
}

/// A resource by its name in shaders. In imported modules, it has the same name.
pub type Named<'a> = (&'static str, &'a dyn Bind);

/// What both lists name.
pub fn join<'a>(one: &[Named<'a>], other: &[Named<'a>]) -> Vec<Named<'a>> {
    [one, other].concat()
}

impl Bind for wgpu::Buffer {
    fn bound(&self) -> Bound<'_> {
        Bound::Buffer(self)
    }
}

impl Bind for HostBuffer {
    fn bound(&self) -> Bound<'_> {
        Bound::Buffer(self)
    }
}

impl Bind for wgpu::TextureView {
    fn bound(&self) -> Bound<'_> {
        Bound::View(self)
    }
}

impl Bind for wgpu::Sampler {
    fn bound(&self) -> Bound<'_> {
        Bound::Sampler(self)
    }
}

impl Bound<'_> {
    fn resource(&self) -> wgpu::BindingResource<'_> {
        match self {
            Self::Buffer(buffer) => buffer.as_entire_binding(),
            Self::View(view) => wgpu::BindingResource::TextureView(view),
            Self::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
        }
    }
}

/// The same as [`Bound`]. Held, so that no other resource takes its identity.
#[derive(Debug)]
enum Held {
    Buffer(wgpu::Buffer),
    View(wgpu::TextureView),
    Sampler(wgpu::Sampler),
}

impl Held {
    fn new(bound: &Bound<'_>) -> Self {
        match *bound {
            Bound::Buffer(buffer) => Self::Buffer(buffer.clone()),
            Bound::View(view) => Self::View(view.clone()),
            Bound::Sampler(sampler) => Self::Sampler(sampler.clone()),
        }
    }

    fn bound(&self) -> Bound<'_> {
        match self {
            Self::Buffer(buffer) => Bound::Buffer(buffer),
            Self::View(view) => Bound::View(view),
            Self::Sampler(sampler) => Bound::Sampler(sampler),
        }
    }
}

/// Values by hashes of their keys, each with the frame that used it last. Of keys with equal hashes, the last one stays.
#[derive(Debug)]
struct Recent<K, V>(FxHashMap<u64, (K, V, u64)>);

impl<K, V> Default for Recent<K, V> {
    fn default() -> Self {
        Self(FxHashMap::default())
    }
}

impl<K, V> Recent<K, V> {
    /// The value whose key has this hash and `is_it`, used in the frame `now`.
    fn get(&mut self, hash: u64, now: u64, is_it: impl FnOnce(&K) -> bool) -> Option<&V> {
        let (key, value, used) = self.0.get_mut(&hash)?;
        is_it(key).then(|| {
            *used = now;
            &*value
        })
    }

    fn insert(&mut self, hash: u64, now: u64, key: K, value: V) {
        self.0.insert(hash, (key, value, now));
    }

    /// Drops what no frame since `first` has used.
    fn forget_before(&mut self, first: u64) {
        self.0.retain(|_, (_, _, used)| *used >= first);
    }
}

fn hash(of: impl Hash) -> u64 {
    let mut hasher = FxHasher::default();
    of.hash(&mut hasher);
    hasher.finish()
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Groups of an interface, by their indices.
type Groups = Vec<(u32, wgpu::BindGroup)>;

/// The bind groups of one interface.
#[derive(Debug, Default)]
pub(super) struct BindGroups {
    /// By the names that passes give: few passes share an interface.
    namings: Vec<Naming>,
    groups: Recent<Vec<Held>, Groups>,
}

/// What a list of names means to an interface.
#[derive(Debug)]
struct Naming {
    /// Address and length of each: names are constants, and to compare their letters in every pass takes long.
    names: Vec<(usize, usize)>,
    /// For each of the declared resources, the place in the list of the one that is bound to it.
    sources: Vec<Option<usize>>,
}

impl Naming {
    /// Of names that fit equally well, the last one counts.
    fn new(resources: &[Named<'_>], declared: &[Declared]) -> Self {
        let fit = |variable: &Declared, name: &str| match variable.name == name {
            true => usize::MAX,
            false => name.len(),
        };
        let source = |variable: &Declared| {
            let all = resources.iter().enumerate();
            let meant = all.filter(|(_, (name, _))| is_linked_name(&variable.name, name));
            let best = meant.max_by_key(|(_, (name, _))| fit(variable, name));
            best.map(|(place, _)| place)
        };
        Self {
            names: resources.iter().map(address).collect(),
            sources: declared.iter().map(source).collect(),
        }
    }

    fn is_of(&self, resources: &[Named<'_>]) -> bool {
        resources.iter().map(address).eq(self.names.iter().copied())
    }
}

fn address((name, _): &Named<'_>) -> (usize, usize) {
    (name.as_ptr() as usize, name.len())
}

/// What the device keeps.
#[derive(Debug, Default)]
pub(super) struct BindingCache {
    /// The number of the present frame.
    frame: AtomicU64,
    constants: Mutex<Recent<Vec<u8>, wgpu::Buffer>>,
    /// Those of all interfaces.
    groups: Mutex<Vec<Weak<Mutex<BindGroups>>>>,
}

impl BindingCache {
    /// The number of the present frame.
    pub fn now(&self) -> u64 {
        self.frame.load(Ordering::Relaxed)
    }

    /// Room for the bind groups of an interface.
    pub fn bind_groups(&self) -> Arc<Mutex<BindGroups>> {
        let made = Arc::default();
        locked(&self.groups).push(Arc::downgrade(&made));
        made
    }

    /// Ends a frame, and now and then drops what was not used for some frames.
    pub fn end_frame(&self) {
        let now = self.frame.fetch_add(1, Ordering::Relaxed) + 1;
        if now.is_multiple_of(PATIENCE) {
            self.forget_before(now - PATIENCE);
        }
    }

    /// Makes way for an allocation of so many bytes.
    pub fn make_way(&self, bytes: u64) {
        if bytes >= LARGE {
            self.forget_before(self.now());
        }
    }

    /// Drops what no frame since `first` has used.
    fn forget_before(&self, first: u64) {
        locked(&self.constants).forget_before(first);
        locked(&self.groups).retain(|groups| match groups.upgrade() {
            Some(groups) => {
                locked(&groups).groups.forget_before(first);
                true
            }
            None => false,
        });
    }
}

impl BindGroups {
    /// Finds, for each of `declared`, the resource of its name, and calls `set` with the groups that bind them; `make`
    /// makes these on first use.
    ///
    /// # Errors
    /// The name of what is declared and not among the resources.
    pub fn with<'a>(
        &mut self,
        now: u64,
        declared: &'a [Declared],
        resources: &[Named<'_>],
        make: impl FnOnce(&[Bound<'_>]) -> Groups,
        set: impl FnOnce(&Groups),
    ) -> Result<(), &'a str> {
        let known = self
            .namings
            .iter()
            .position(|naming| naming.is_of(resources));
        let naming = known.unwrap_or_else(|| {
            self.namings.push(Naming::new(resources, declared));
            self.namings.len() - 1
        });
        let sources = self.namings[naming].sources.iter();
        let found: Vec<Bound<'_>> = sources
            .zip(declared)
            .map(|(source, variable)| match source {
                Some(place) => Ok(resources[*place].1.bound()),
                None => Err(variable.name.as_str()),
            })
            .collect::<Result<_, _>>()?;
        let hash = hash(&found);
        let is_it = |held: &Vec<Held>| held.iter().map(Held::bound).eq(found.iter().copied());
        match self.groups.get(hash, now, is_it) {
            Some(groups) => set(groups),
            None => {
                let groups = make(&found);
                set(&groups);
                let held = found.iter().map(Held::new).collect();
                self.groups.insert(hash, now, held, groups);
            }
        }
        Ok(())
    }
}

/// One bind group per layout, of the `declared` resources, which are sorted by group.
pub(super) fn bind_all(
    device: &wgpu::Device,
    label: &str,
    layouts: &[Option<wgpu::BindGroupLayout>],
    declared: &[Declared],
    found: &[Bound<'_>],
) -> Groups {
    let all: Vec<_> = declared.iter().zip(found).collect();
    let of_group = all.chunk_by(|(variable, _), (next, _)| variable.group == next.group);
    let groups = of_group.filter_map(|of_group| {
        let group = of_group[0].0.group;
        let layout = layouts.get(group as usize)?.as_ref()?;
        let entries = of_group
            .iter()
            .map(|(variable, found)| wgpu::BindGroupEntry {
                binding: variable.binding,
                resource: found.resource(),
            });
        let made = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(label),
            layout,
            entries: &entries.collect::<Vec<_>>(),
        });
        Some((group, made))
    });
    groups.collect()
}

impl Gpu {
    /// A uniform buffer that holds `data`, to be bound and never written: the same one for the same data, as long as
    /// frames ask for it.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn constant<T: bytemuck::NoUninit>(
        &self,
        label: &str,
        data: &T,
    ) -> Result<wgpu::Buffer, GpuError> {
        let bytes = bytemuck::bytes_of(data);
        let hash = hash(bytes);
        let now = self.bindings.now();
        let mut constants = locked(&self.bindings.constants);
        if let Some(found) = constants.get(hash, now, |known| known == bytes) {
            return Ok(found.clone());
        }
        let made = self.uniform(label, data)?;
        constants.insert(hash, now, bytes.to_vec(), made.clone());
        Ok(made)
    }

    /// Number of bind groups and of constants that are kept.
    #[cfg(test)]
    pub(crate) fn kept_count(&self) -> [usize; 2] {
        let groups = locked(&self.bindings.groups);
        let groups = groups.iter().filter_map(Weak::upgrade);
        let groups = groups.map(|groups| locked(&groups).groups.0.len()).sum();
        [groups, locked(&self.bindings.constants).0.len()]
    }
}
