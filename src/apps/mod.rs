//! What a light field is for: disparity, refocusing, moving the viewpoint, a page to play with.

pub mod picture;
pub mod refocus;
pub mod relief;
pub mod viewer;
pub mod viewpoint;
