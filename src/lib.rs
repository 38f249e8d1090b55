//! Raw captures of lenslet light-field cameras to high-resolution light fields, and what a light field is for.
//!
//! ```
//! # use lenslet_data_gen::simulate::{Camera, Scene, SceneName, SimulationOptions, render_capture};
//! # use lenslet_core::container::write_lfp;
//! # let folder = tempfile::tempdir()?;
//! # let (white, image) = (folder.path().join("white.lfp"), folder.path().join("IMG_0001.lfp"));
//! # let (simulated, options) = (Camera::with_sensor(240), SimulationOptions { whites: 1, ..Default::default() });
//! # let scene = Scene::named(SceneName::Natural, &simulated, None, 1, &lenslet_core::progress::Silent)?;
//! # let simulation = render_capture(&scene, &simulated, &options, &lenslet_core::progress::Silent)?;
//! # write_lfp(&white, &simulation.whites[0], false)?;
//! # write_lfp(&image, &simulation.capture, false)?;
//! use lenslet::prelude::*;
//!
//! let camera = Calibration::from_whites(&[&white])?; // white.lfp
//! let samples = Capture::open(&image)?.decode(&camera)?; // IMG_0001.lfp; refuses another camera's calibration
//! let learned = samples.renderer(Method::barycentric().learned()).longer_side(80).prepare()?;
//! let centre: View = learned.view(3, 3)?; // linear light, which is part of its type
//! assert_eq!((centre.width(), centre.height(), centre.channels()), (80, 80, 3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! This crate gathers the ones below it: reading ([`container`]), [`calibration`], [`decode`], rendering ([`views`]),
//! sparse coding ([`sparse`]), dictionaries ([`dictionary`], learned by `train` behind the feature of that name), light
//! fields ([`lightfield`]) and scores ([`metrics`]). It adds [`apps`]: refocusing, depth, views from between the views,
//! a page to play with. The `lenslet` program, behind the feature `cli` (on by default), is built on it; a program that
//! needs only the library sets `default-features = false`.

pub mod apps;
pub mod image_io;
#[cfg(feature = "pages")]
pub mod page;
pub mod prelude;

pub use lenslet_core::{
    calibration, container, decode, dictionary, interpolation, lightfield, metrics, output, progress, sampling, sparse,
};
pub use lenslet_views::{self as views, disparity, interpolate, multiview, reconstruct};
#[cfg(feature = "train")]
pub use {lenslet_data_gen as data_gen, lenslet_train as train};
