//! Compiles a pattern to a deterministic automaton by Thompson's construction, subset construction, and minimization by
//! Moore's partition refinement. Every stage is bounded in size.

use std::collections::{HashMap, VecDeque};

use super::pattern::{Node, PatternError, SYMBOLS, parse};

/// Maximum number of states of a deterministic automaton before minimization.
pub(super) const MAX_STATES: usize = 1024;

/// Maximum number of steps in building the nondeterministic automaton. This also bounds its states.
const MAX_STEPS: usize = 4096;

const LIGHT: usize = 0;
/// Columns of D, G, S and V.
const LOBES: [usize; 4] = [1, 2, 3, 4];
const EYE: usize = 5;

/// The paths of a pattern, read from the eye to the light, which is the order in which a path tracer visits them. This
/// is the smallest deterministic automaton of the reversed language. State 0 is the start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PathAutomaton {
    /// The next state per state and symbol; symbols are in the order L, D, G, S, V, E.
    pub transitions: Vec<[u32; SYMBOLS.len()]>,
    /// Whether a path may end in each state.
    pub accepting: Vec<bool>,
    /// The state that no transition leaves and in which no path may end. `None` if every prefix can be completed.
    pub dead: Option<u32>,
}

impl PathAutomaton {
    /// Words per state in [`words`](Self::words).
    pub const WORDS_PER_STATE: usize = SYMBOLS.len() + 1;

    /// Compiles a pattern.
    ///
    /// # Errors
    /// [`PatternError`]. Time and memory are bounded, whatever the pattern.
    pub fn compile(pattern: &str) -> Result<Self, PatternError> {
        Self::read(pattern, Order::FromEye)
    }

    /// Compiles a pattern whose paths are read from the light to the eye, which is the order in which photons visit
    /// them.
    ///
    /// # Errors
    /// See [`compile`](Self::compile).
    pub(super) fn compile_from_light(pattern: &str) -> Result<Self, PatternError> {
        Self::read(pattern, Order::FromLight)
    }

    fn read(pattern: &str, order: Order) -> Result<Self, PatternError> {
        let mut choices = Choices {
            states: vec![Choice::End],
            steps: 0,
            order,
        };
        let start = choices.build(&parse(pattern)?, 0)?;
        Ok(minimized(&determinized(&choices.states, start)?))
    }

    /// Whether the pattern matches all of `path`, which is written from the light to the eye, such as `LDE`.
    pub fn accepts(&self, path: &str) -> bool {
        let mut state = 0;
        for symbol in path.chars().rev() {
            let Some(column) = SYMBOLS.iter().position(|&letter| letter == symbol) else {
                return false;
            };
            state = self.transitions[state][column] as usize;
        }
        self.accepting[state]
    }

    /// Maximum number of vertices between light and eye over the pattern's paths of the form `L[DGSV]*E`. `None` if
    /// there is no maximum; 0 if there is no such path.
    pub fn most_vertices(&self) -> Option<u32> {
        // A path that visits a state twice can be lengthened indefinitely if the light can be reached from that state.
        // So first remove the states from which it cannot be reached. If the rest has no cycle, walking it takes at
        // most as many steps as there are states.
        let ends = |state: usize| self.accepting[self.transitions[state][LIGHT] as usize];
        let lobes = |state: usize| LOBES.map(|symbol| self.transitions[state][symbol] as usize);
        let count = self.transitions.len();
        let mut is_useful: Vec<bool> = (0..count).map(ends).collect();
        for _ in 0..count {
            for state in 0..count {
                is_useful[state] |= lobes(state).iter().any(|&next| is_useful[next]);
            }
        }
        let mut reached = vec![self.transitions[0][EYE] as usize];
        let mut most = 0;
        for vertices in 0..=count as u32 {
            reached.retain(|&state| is_useful[state]);
            if reached.is_empty() {
                return Some(most);
            }
            if reached.iter().any(|&state| ends(state)) {
                most = vertices;
            }
            reached = reached.into_iter().flat_map(lobes).collect();
            reached.sort_unstable();
            reached.dedup();
        }
        None
    }

    /// The automaton for a shader, with [`WORDS_PER_STATE`](Self::WORDS_PER_STATE) words per state: the next state
    /// after L, D, G, S, V and E, then flags. Flag bit 0 means accepting, which matters after the last symbol. Bit 1
    /// means dead: no continuation is accepted. State 0 is the start.
    pub fn words(&self) -> Vec<u32> {
        let mut words = Vec::with_capacity(self.transitions.len() * Self::WORDS_PER_STATE);
        for (state, (next, &accepting)) in
            (0_u32..).zip(self.transitions.iter().zip(&self.accepting))
        {
            words.extend(next);
            words.push(u32::from(accepting) | u32::from(self.dead == Some(state)) << 1);
        }
        words
    }
}

/// Whether a pattern accepts paths that were read by halves: for each state of `from_light`, which has read one end, and
/// each state of `from_eye`, which has read the other, in this order. Both are automata of one pattern. Of a minimal
/// automaton, the state alone decides how the path may go on (Myhill and Nerode), so any word that leads there does.
pub(super) fn joint(from_light: &PathAutomaton, from_eye: &PathAutomaton) -> Vec<bool> {
    let (rows, columns) = (from_light.transitions.len(), from_eye.transitions.len());
    let mut accepts = vec![false; rows * columns];
    for (row, &is_accepting) in from_light.accepting.iter().enumerate() {
        accepts[row * columns] = is_accepting;
    }
    let mut is_reached = vec![false; columns];
    is_reached[0] = true;
    let mut queue = VecDeque::from([0]);
    while let Some(state) = queue.pop_front() {
        for (symbol, &next) in from_eye.transitions[state].iter().enumerate() {
            let next = next as usize;
            if !std::mem::replace(&mut is_reached[next], true) {
                for (row, after) in from_light.transitions.iter().enumerate() {
                    let after = after[symbol] as usize;
                    accepts[row * columns + next] = accepts[after * columns + state];
                }
                queue.push_back(next);
            }
        }
    }
    accepts
}

/// A shortest path L[DGSV]*E, written from the light to the eye, for which `is_wanted` returns true. The argument of
/// `is_wanted` tells which automata accept the path.
pub(super) fn shortest_path(
    automata: &[PathAutomaton],
    is_wanted: impl Fn(&[bool]) -> bool,
) -> Option<String> {
    let step = |states: &[u32], symbol: usize| -> Vec<u32> {
        let next = |(automaton, &state): (&PathAutomaton, &u32)| {
            automaton.transitions[state as usize][symbol]
        };
        automata.iter().zip(states).map(next).collect()
    };
    // Breadth-first search over the joint states of all automata. Each joint state remembers the lobes that lead to it,
    // starting at the light's end.
    let start = step(&vec![0; automata.len()], EYE);
    let mut found = HashMap::from([(start.clone(), String::new())]);
    let mut queue = VecDeque::from([start]);
    while let Some(states) = queue.pop_front() {
        let ends = step(&states, LIGHT);
        let accepting =
            |(automaton, &state): (&PathAutomaton, &u32)| automaton.accepting[state as usize];
        if is_wanted(
            &automata
                .iter()
                .zip(&ends)
                .map(accepting)
                .collect::<Vec<_>>(),
        ) {
            return Some(format!("L{}E", found[&states]));
        }
        for symbol in LOBES {
            let next = step(&states, symbol);
            if !found.contains_key(&next) {
                let lobes = format!("{}{}", SYMBOLS[symbol], found[&states]);
                found.insert(next.clone(), lobes);
                queue.push_back(next);
            }
        }
    }
    None
}

/// A state of the nondeterministic automaton.
#[derive(Clone, Copy)]
enum Choice {
    /// Reads one symbol of a set, then continues in the given state.
    Read(u8, usize),
    /// Continues in either state.
    Either(usize, usize),
    End,
}

/// The order in which an automaton reads the symbols of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Order {
    FromEye,
    FromLight,
}

struct Choices {
    states: Vec<Choice>,
    steps: usize,
    order: Order,
}

impl Choices {
    fn add(&mut self, state: Choice) -> usize {
        self.states.push(state);
        self.states.len() - 1
    }

    /// The state that reads `node` and then continues in `after`.
    fn build(&mut self, node: &Node, mut after: usize) -> Result<usize, PatternError> {
        // Count each visit, because nested repetitions of nothing create no states.
        self.steps += 1;
        if self.steps > MAX_STEPS {
            return Err(PatternError::TooComplex);
        }
        match node {
            Node::Symbols(set) => Ok(self.add(Choice::Read(*set, after))),
            Node::Sequence(nodes) => {
                // The node that is read last comes first.
                let from_eye = self.order == Order::FromEye;
                for index in 0..nodes.len() {
                    let last = nodes.len() - 1 - index;
                    after = self.build(&nodes[if from_eye { index } else { last }], after)?;
                }
                Ok(after)
            }
            Node::Choice(branches) => {
                let (first, others) = branches.split_first().expect("a choice has a branch");
                let mut start = self.build(first, after)?;
                for branch in others {
                    let other = self.build(branch, after)?;
                    start = self.add(Choice::Either(start, other));
                }
                Ok(start)
            }
            Node::Repeat { node, least, most } => {
                let mut start = after;
                match most {
                    None => {
                        start = self.add(Choice::End);
                        let again = self.build(node, start)?;
                        self.states[start] = Choice::Either(again, after);
                    }
                    Some(most) => {
                        for _ in *least..*most {
                            let once_more = self.build(node, start)?;
                            start = self.add(Choice::Either(once_more, after));
                        }
                    }
                }
                for _ in 0..*least {
                    start = self.build(node, start)?;
                }
                Ok(start)
            }
        }
    }
}

/// Subset construction: each state is the set of states that the nondeterministic automaton may be in.
fn determinized(states: &[Choice], start: usize) -> Result<PathAutomaton, PatternError> {
    // The sorted `Read` and `End` states that can be reached from `from` without reading a symbol.
    let closure = |mut from: Vec<usize>| {
        let mut is_seen = vec![false; states.len()];
        let mut subset = Vec::new();
        while let Some(state) = from.pop() {
            if std::mem::replace(&mut is_seen[state], true) {
                continue;
            }
            match states[state] {
                Choice::Either(a, b) => from.extend([a, b]),
                Choice::Read(..) | Choice::End => subset.push(state),
            }
        }
        subset.sort_unstable();
        subset
    };
    let mut subsets = vec![closure(vec![start])];
    let mut numbers = HashMap::from([(subsets[0].clone(), 0)]);
    let mut automaton = PathAutomaton {
        transitions: Vec::new(),
        accepting: Vec::new(),
        dead: None,
    };
    while automaton.transitions.len() < subsets.len() {
        let subset = subsets[automaton.transitions.len()].clone();
        let mut next = [0; SYMBOLS.len()];
        for (symbol, next) in next.iter_mut().enumerate() {
            let after = subset.iter().filter_map(|&state| match states[state] {
                Choice::Read(set, after) if set >> symbol & 1 == 1 => Some(after),
                _ => None,
            });
            let after = closure(after.collect());
            *next = match numbers.get(&after) {
                Some(&number) => number,
                None if subsets.len() == MAX_STATES => return Err(PatternError::TooComplex),
                None => {
                    let number = subsets.len() as u32;
                    numbers.insert(after.clone(), number);
                    subsets.push(after);
                    number
                }
            };
        }
        automaton.transitions.push(next);
        automaton.accepting.push(
            subset
                .iter()
                .any(|&state| matches!(states[state], Choice::End)),
        );
    }
    Ok(automaton)
}

/// Merges the states that no continuation distinguishes. Starts with two classes, accepting or not, and splits a class
/// while its states lead to different classes. Classes are numbered in order of appearance, so that the start remains
/// state 0.
fn minimized(automaton: &PathAutomaton) -> PathAutomaton {
    let mut class_of: Vec<u32> = automaton
        .accepting
        .iter()
        .map(|&is_accepting| is_accepting.into())
        .collect();
    let mut count = 0;
    loop {
        let mut numbers = HashMap::new();
        let refined: Vec<u32> = (0..class_of.len())
            .map(|state| {
                let next = automaton.transitions[state].map(|next| class_of[next as usize]);
                let fresh = numbers.len() as u32;
                *numbers.entry((class_of[state], next)).or_insert(fresh)
            })
            .collect();
        class_of = refined;
        if numbers.len() == count {
            break;
        }
        count = numbers.len();
    }
    let mut smallest = PathAutomaton {
        transitions: Vec::new(),
        accepting: Vec::new(),
        dead: None,
    };
    for (state, &class) in class_of.iter().enumerate() {
        if class as usize == smallest.transitions.len() {
            let next = automaton.transitions[state].map(|next| class_of[next as usize]);
            let is_stuck = next.iter().all(|&next| next == class) && !automaton.accepting[state];
            smallest.transitions.push(next);
            smallest.accepting.push(automaton.accepting[state]);
            smallest.dead = smallest.dead.or(is_stuck.then_some(class));
        }
    }
    smallest
}
