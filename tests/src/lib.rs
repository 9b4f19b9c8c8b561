//! End-to-end suites, and what they share.
//!
//! [`accuracy`] judges the finished program from outside, by its command line, against reference images.

pub mod accuracy;
