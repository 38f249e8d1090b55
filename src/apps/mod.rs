//! What a light field is for: disparity, refocusing, moving the viewpoint, a page to play with.

pub mod disparity;
