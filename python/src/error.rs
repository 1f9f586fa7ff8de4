//! What went wrong, as Python is told.

use pyo3::PyErr;
use pyo3::exceptions::PyException;

pyo3::create_exception!(deepfield, Error, PyException, "What deepfield cannot do, in the line that the program says.");

/// Why something could not be done.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// The exception for a failure.
pub fn told(failure: Failure) -> PyErr {
    Error::new_err(failure.to_string())
}
