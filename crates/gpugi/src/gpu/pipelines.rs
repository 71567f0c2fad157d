//! Pipelines and layouts that a device keeps: another scene, another set of techniques or a setting that comes back
//! compiles nothing that was compiled before.

use std::borrow::Cow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};

use rustc_hash::FxHashMap;

/// From so many pipelines on, those are dropped that nobody uses.
const MOST: usize = 512;

/// All that a pipeline is compiled from.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Recipe {
    /// WGSL.
    pub source: Cow<'static, str>,
    /// Linked names and bits of the constants that are overridden.
    pub constants: Vec<(String, u64)>,
    /// Layouts of the bind groups.
    pub layouts: Vec<Option<wgpu::BindGroupLayout>>,
    /// Entry points and fixed-function state, in any words.
    pub state: String,
}

/// A pipeline that is there once it is compiled.
pub(super) type Made<P> = Arc<OnceLock<P>>;

/// Pipelines by what they are compiled from.
#[derive(Debug)]
pub(super) struct Pipelines<P>(Arc<Mutex<FxHashMap<Recipe, Kept<P>>>>);

#[derive(Debug)]
enum Kept<P> {
    /// A pipeline that compiles, and counts of pipelines that wait for it to do so.
    Compiling(Weak<OnceLock<P>>, Vec<Arc<AtomicUsize>>),
    Made(Made<P>),
}

impl<P> Default for Pipelines<P> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<P> Clone for Pipelines<P> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<P> Pipelines<P> {
    fn kept(&self) -> MutexGuard<'_, FxHashMap<Recipe, Kept<P>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The pipeline of `recipe`, and whether the caller is to compile it and then to call [`Pipelines::done`]. Until it
    /// is done, `compiling` counts it.
    pub fn get(&self, recipe: &Recipe, compiling: &Arc<AtomicUsize>) -> (Made<P>, bool) {
        let mut kept = self.kept();
        match kept.get_mut(recipe) {
            Some(Kept::Made(made)) => return (made.clone(), false),
            Some(Kept::Compiling(made, counts)) => {
                // Who compiles it holds it until it is done.
                if let Some(made) = made.upgrade() {
                    compiling.fetch_add(1, Ordering::Relaxed);
                    counts.push(compiling.clone());
                    return (made, false);
                }
            }
            None => (),
        }
        if kept.len() >= MOST {
            kept.retain(|_, pipeline| match pipeline {
                Kept::Compiling(..) => true,
                Kept::Made(made) => Arc::strong_count(made) > 1,
            });
        }
        let made = Arc::new(OnceLock::new());
        compiling.fetch_add(1, Ordering::Relaxed);
        let entry = Kept::Compiling(Arc::downgrade(&made), vec![compiling.clone()]);
        kept.insert(recipe.clone(), entry);
        (made, true)
    }

    /// Whether anybody but who is to compile the pipeline still holds it. If not, it is forgotten.
    pub fn is_wanted(&self, recipe: &Recipe, made: &Made<P>) -> bool {
        let mut kept = self.kept();
        // Nobody gets it meanwhile.
        let is_wanted = Arc::strong_count(made) > 1;
        if !is_wanted {
            kept.remove(recipe).inspect(Kept::count_down);
        }
        is_wanted
    }

    /// Takes notice that a pipeline has been compiled. One that `is_faulty` is not kept: whoever makes it again is told.
    pub fn done(&self, recipe: Recipe, made: Made<P>, is_faulty: bool) {
        let mut kept = self.kept();
        let before = match is_faulty {
            true => kept.remove(&recipe),
            false => kept.insert(recipe, Kept::Made(made)),
        };
        before.inspect(Kept::count_down);
    }
}

impl<P> Kept<P> {
    fn count_down(&self) {
        if let Self::Compiling(_, counts) = self {
            for count in counts {
                count.fetch_sub(1, Ordering::Relaxed);
            }
        }
    }
}

/// Layouts of bind groups, one of each kind: equal ones make equal recipes.
#[derive(Debug, Default)]
pub(super) struct Layouts(Mutex<FxHashMap<Vec<wgpu::BindGroupLayoutEntry>, wgpu::BindGroupLayout>>);

impl Layouts {
    /// The layout with these entries; `label` names it if it is new.
    pub fn get(
        &self,
        device: &wgpu::Device,
        label: &str,
        entries: Vec<wgpu::BindGroupLayoutEntry>,
    ) -> wgpu::BindGroupLayout {
        let mut layouts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let layout = layouts.entry(entries).or_insert_with_key(|entries| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries,
            })
        });
        layout.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recipe(state: &str) -> Recipe {
        Recipe {
            source: Cow::Borrowed("source"),
            constants: Vec::new(),
            layouts: Vec::new(),
            state: state.to_owned(),
        }
    }

    #[test]
    fn a_pipeline_is_compiled_once_and_counted_by_all_who_wait() {
        let pipelines = Pipelines::<u32>::default();
        let [first, second] = [(); 2].map(|()| Arc::new(AtomicUsize::new(0)));
        let counts = || [&first, &second].map(|count| count.load(Ordering::Relaxed));
        let (made, is_new) = pipelines.get(&recipe("a"), &first);
        assert!(is_new);
        let (same, is_new) = pipelines.get(&recipe("a"), &second);
        assert!(!is_new && Arc::ptr_eq(&made, &same));
        let (other, is_new) = pipelines.get(&recipe("b"), &second);
        assert!(is_new && !Arc::ptr_eq(&made, &other));
        assert_eq!(counts(), [1, 2]);
        drop(same);
        // The second still holds it, the first compiles it.
        let second_holds = made.clone();
        assert!(pipelines.is_wanted(&recipe("a"), &made));
        made.set(7).unwrap();
        pipelines.done(recipe("a"), made, false);
        assert_eq!(counts(), [0, 1]);
        drop(second_holds);
        let (kept, is_new) = pipelines.get(&recipe("a"), &first);
        assert!(!is_new && kept.get() == Some(&7));
        assert_eq!(counts(), [0, 1]);
        // Nobody wants the other one any more.
        assert!(!pipelines.is_wanted(&recipe("b"), &other));
        assert_eq!(counts(), [0, 0]);
        let (faulty, is_new) = pipelines.get(&recipe("b"), &first);
        assert!(is_new);
        pipelines.done(recipe("b"), faulty, true);
        assert_eq!(counts(), [0, 0]);
        assert!(pipelines.get(&recipe("b"), &first).1);
    }

    #[test]
    fn what_nobody_uses_is_dropped_when_there_are_too_many() {
        let pipelines = Pipelines::<u32>::default();
        let count = Arc::default();
        let mut used = Vec::new();
        for index in 0..MOST {
            let (made, _) = pipelines.get(&recipe(&index.to_string()), &count);
            if index % 2 == 0 {
                used.push(made.clone());
            }
            pipelines.done(recipe(&index.to_string()), made, false);
        }
        assert_eq!(pipelines.kept().len(), MOST);
        assert!(pipelines.get(&recipe("one more"), &count).1);
        assert_eq!(pipelines.kept().len(), MOST / 2 + 1);
        assert!(!pipelines.get(&recipe("0"), &count).1);
    }
}
