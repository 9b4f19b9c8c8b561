//! What a caller, the renderer and (one day) a queue between them exchange: requests, settings, results.
//!
//! A [`RenderRequest`] is what HTTP, the command line and the page send. [`RenderRequest::resolve`] fills in every
//! default from one table and gives a [`RenderSpec`], which says all that the pixels depend on; [`identity`] makes its
//! key. What may be requested is described by data: a [`Catalogue`] of techniques with their [`Setting`]s, [`Preset`]s
//! and outputs. No GPU and no async runtime are known here.

pub mod catalogue;
pub mod check;
pub mod fault;
pub mod identity;
pub mod inspection;
pub mod request;
pub mod resolve;
pub mod result;
pub mod setting;
pub mod settings;

pub use catalogue::{Catalogue, Chosen, OutputDescription, Preset, TechniqueAlias, TechniqueDescription};
pub use fault::Fault;
pub use inspection::{Column, Disc, Field, Inspection, Row, Value};
pub use request::{CameraRequest, RenderRequest, Whole};
pub use resolve::{CameraDefaults, MaterialMode, RenderSpec, RequestLimits, SceneDefaults, StopRules};
pub use result::{ErrorEstimate, JobProgress, PassTime, RayCounts, RenderOutput, SkippedPass};
pub use setting::{Setting, SettingKind, SettingValue};
pub use settings::Settings;
