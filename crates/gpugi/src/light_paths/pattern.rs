//! Regular expressions over the symbols of light paths: grammar and errors.
//!
//! ```text
//! pattern  = sequence ('|' sequence)*
//! sequence = (atom repetition?)*
//! atom     = 'L' | 'D' | 'G' | 'S' | 'V' | 'E' | '.' | '[' '^'? symbol+ ']' | '(' pattern ')'
//! repetition = '*' | '+' | '?' | '{m}' | '{m,}' | '{m,n}'
//! ```

use super::automaton::MAX_STATES;

/// The symbols of a path, in the order of the automaton's columns.
pub(super) const SYMBOLS: [char; 6] = ['L', 'D', 'G', 'S', 'V', 'E'];

/// Maximum length of a pattern (characters). It bounds the parser's recursion.
const MAX_LENGTH: usize = 256;

/// Maximum count in a repetition.
pub(super) const MAX_COUNT: u32 = 32;

/// The reason why a pattern is invalid. Positions count characters from 1.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PatternError {
    /// The pattern contains something outside the grammar.
    #[error("light path pattern, character {position}: {reason}")]
    Syntax {
        /// Position (character, from 1).
        position: usize,
        /// The problem at this position, and what is expected.
        reason: String,
    },
    /// The pattern is too long.
    #[error(
        "a light path pattern of {length} characters: at most {MAX_LENGTH}; shorten it with classes and repetitions"
    )]
    TooLong {
        /// Length of the pattern (characters).
        length: usize,
    },
    /// The automaton would exceed its size limit.
    #[error(
        "the light path pattern needs more than {MAX_STATES} states: use smaller or fewer counted repetitions"
    )]
    TooComplex,
}

/// The syntax tree of a pattern.
#[derive(Debug)]
pub(super) enum Node {
    /// Any one symbol of a set; bit i stands for `SYMBOLS[i]`.
    Symbols(u8),
    Sequence(Vec<Node>),
    Choice(Vec<Node>),
    /// At least `least` repetitions, and at most `most` if it is set.
    Repeat {
        node: Box<Node>,
        least: u32,
        most: Option<u32>,
    },
}

pub(super) fn parse(pattern: &str) -> Result<Node, PatternError> {
    let text: Vec<char> = pattern.chars().take(MAX_LENGTH + 1).collect();
    if text.len() > MAX_LENGTH {
        return Err(PatternError::TooLong {
            length: pattern.chars().count(),
        });
    }
    let mut parser = Parser { text, at: 0 };
    let node = parser.choice()?;
    match parser.peek() {
        None => Ok(node),
        // A choice ends at the end of the pattern or at a closing parenthesis.
        Some(_) => Err(parser.error("')' without '('".into())),
    }
}

struct Parser {
    text: Vec<char>,
    at: usize,
}

impl Parser {
    fn peek(&self) -> Option<char> {
        self.text.get(self.at).copied()
    }

    fn take(&mut self, wanted: char) -> bool {
        let found = self.peek() == Some(wanted);
        self.at += usize::from(found);
        found
    }

    /// An error at the next character.
    fn error(&self, reason: String) -> PatternError {
        PatternError::Syntax {
            position: self.at + 1,
            reason,
        }
    }

    /// An error that names the next character and what was expected instead.
    fn unexpected(&self, wanted: &str) -> PatternError {
        self.error(match self.peek() {
            Some(found) => format!("found {found:?}, wanted {wanted}"),
            None => format!("the pattern ends, wanted {wanted}"),
        })
    }

    fn choice(&mut self) -> Result<Node, PatternError> {
        let mut branches = vec![self.sequence()?];
        while self.take('|') {
            branches.push(self.sequence()?);
        }
        Ok(Node::Choice(branches))
    }

    fn sequence(&mut self) -> Result<Node, PatternError> {
        let mut nodes = Vec::new();
        while !matches!(self.peek(), None | Some('|' | ')')) {
            let node = self.atom()?;
            nodes.push(self.repetition(node)?);
        }
        Ok(Node::Sequence(nodes))
    }

    fn atom(&mut self) -> Result<Node, PatternError> {
        if self.take('(') {
            let node = self.choice()?;
            if !self.take(')') {
                return Err(self.unexpected("')'"));
            }
            return Ok(node);
        }
        if self.take('[') {
            return self.class();
        }
        if self.take('.') {
            return Ok(Node::Symbols(all_symbols()));
        }
        match self.symbol() {
            Some(bit) => Ok(Node::Symbols(bit)),
            None if matches!(self.peek(), Some('*' | '+' | '?' | '{')) => {
                Err(self.error("nothing to repeat before it".into()))
            }
            None => Err(self.unexpected("a symbol (L, D, G, S, V, E), '.', '[' or '('")),
        }
    }

    fn symbol(&mut self) -> Option<u8> {
        let index = SYMBOLS
            .iter()
            .position(|&letter| Some(letter) == self.peek())?;
        self.at += 1;
        Some(1 << index)
    }

    /// Parses what follows `[`.
    fn class(&mut self) -> Result<Node, PatternError> {
        let is_negated = self.take('^');
        let mut set = 0;
        while let Some(bit) = self.symbol() {
            set |= bit;
        }
        if set == 0 || self.peek() != Some(']') {
            return Err(self.unexpected("a symbol (L, D, G, S, V, E) or ']' after symbols"));
        }
        if is_negated {
            set = all_symbols() & !set;
        }
        if set == 0 {
            return Err(self.error("a class that no symbol is in".into()));
        }
        self.at += 1;
        Ok(Node::Symbols(set))
    }

    fn repetition(&mut self, node: Node) -> Result<Node, PatternError> {
        let (least, most) = match self.peek() {
            Some('*') => (0, None),
            Some('+') => (1, None),
            Some('?') => (0, Some(1)),
            Some('{') => self.counts()?,
            _ => return Ok(node),
        };
        self.at += 1;
        if matches!(self.peek(), Some('*' | '+' | '?' | '{')) {
            return Err(self.error("a repetition of a repetition: use parentheses".into()));
        }
        Ok(Node::Repeat {
            node: Box::new(node),
            least,
            most,
        })
    }

    /// The counts of `{m}`, `{m,}` or `{m,n}`; stops at the closing brace.
    fn counts(&mut self) -> Result<(u32, Option<u32>), PatternError> {
        self.at += 1;
        let least = self.count()?;
        let mut most = Some(least);
        if self.take(',') {
            most = match self.peek() {
                Some('}') => None,
                _ => Some(self.count()?),
            };
        }
        if self.peek() != Some('}') {
            return Err(self.unexpected("'}'"));
        }
        if most.is_some_and(|most| most < least) {
            return Err(self.error("at most fewer than at least".into()));
        }
        Ok((least, most))
    }

    fn count(&mut self) -> Result<u32, PatternError> {
        let start = self.at;
        let mut value = 0_u32;
        while let Some(digit) = self.peek().and_then(|letter| letter.to_digit(10)) {
            value = value.saturating_mul(10).saturating_add(digit);
            self.at += 1;
        }
        if self.at == start {
            return Err(self.unexpected("a number"));
        }
        if value > MAX_COUNT {
            self.at = start;
            return Err(self.error(format!("a count above {MAX_COUNT}")));
        }
        Ok(value)
    }
}

fn all_symbols() -> u8 {
    (1 << SYMBOLS.len()) - 1
}
