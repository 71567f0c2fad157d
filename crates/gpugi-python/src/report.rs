//! Progress, and Ctrl-C, between the steps of long work.

use std::ops::ControlFlow;

use pyo3::prelude::*;

/// Calls back, and notices Ctrl-C.
pub struct Report {
    call: Option<Py<PyAny>>,
    error: Option<PyErr>,
}

impl Report {
    /// `call` takes the part that is done, 0 to 1, and what is being done, in words.
    pub fn new(call: Option<Py<PyAny>>) -> Self {
        Self { call, error: None }
    }

    /// To be called between steps, without Python's lock.
    pub fn step(&mut self, part: f64, words: &str) -> ControlFlow<()> {
        if self.error.is_some() {
            return ControlFlow::Break(());
        }
        let gone_on = Python::attach(|py| {
            py.check_signals()?;
            match &self.call {
                Some(call) => call.call1(py, (part, words)).map(drop),
                None => Ok(()),
            }
        });
        match gone_on {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                self.error = Some(error);
                ControlFlow::Break(())
            }
        }
    }

    /// Whether an exception has ended the work.
    pub fn has_ended(&self) -> bool {
        self.error.is_some()
    }

    /// The exception that ended the work, if one did.
    pub fn end(self) -> PyResult<()> {
        self.error.map_or(Ok(()), Err)
    }
}
