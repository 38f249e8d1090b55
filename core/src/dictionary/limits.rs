//! Largest numbers a dictionary may have: no file can make the reader allocate more than these allow.

/// Atoms, anchors or outputs of a layer.
pub const ATOMS: usize = 1 << 16;
/// Features of a patch.
pub const FEATURES: usize = 1024;
/// Side of a window or patch, pixels.
pub const SIDE: usize = 65;
/// Models of a dictionary, and layers of a network.
pub const PARTS: usize = 16;
/// Bytes of a file's header.
pub const HEADER: usize = 1 << 22;
/// Bytes of a file.
pub const FILE: u64 = 1 << 30;
