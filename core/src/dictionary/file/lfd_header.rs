//! The header of an `.lfd` file: bincode 2, standard configuration, little-endian variable-length integers.
//!
//! Types for the file only: the order of their fields and variants never changes, since the bytes depend on it.

use serde::{Deserialize, Serialize};

use super::super::limits;
use super::super::model::{Footprint, Storage};
use super::super::side_input::SideInput;
use crate::interpolation::Interpolation;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Header {
    pub(super) tool: String,
    /// JSON of [`super::super::Recipe`].
    pub(super) recipe: String,
    pub(super) storage: StorageCode,
    pub(super) models: Vec<ModelHeader>,
    pub(super) tables: Vec<Table>,
    /// Of the payload.
    pub(super) sha256: [u8; 32],
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct ModelHeader {
    pub(super) footprint: FootprintCode,
    pub(super) base: InterpolationCode,
    pub(super) pitch: f64,
    /// Always one now; earlier files may have several, applied one after the other.
    pub(super) passes: Vec<PassHeader>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct PassHeader {
    pub(super) support: u32,
    pub(super) patch: u32,
    pub(super) floor: f32,
    pub(super) lambda: f32,
    /// Always false now; true in earlier files whose codes are of the ridge regressor's residual.
    pub(super) with_linear: bool,
    pub(super) anchored: bool,
}

/// What follows the header since version 3, one for every network.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct NetworkHeader {
    pub(super) model: u32,
    /// Always 0 now.
    pub(super) pass: u32,
    pub(super) support: u32,
    pub(super) floor: f32,
    pub(super) side_inputs: Vec<SideInputCode>,
    pub(super) filters_per_input: Vec<u32>,
    pub(super) layers: u32,
}

/// Where a matrix lies in the payload.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Table {
    pub(super) name: String,
    pub(super) bytes_per_value: u8,
    pub(super) shape: Vec<u64>,
    pub(super) offset: u64,
}

/// [`Storage`] in the file.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) enum StorageCode {
    F32,
    I8,
}

/// [`Footprint`] in the file.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) enum FootprintCode {
    Point,
    Lenslet,
    Grid,
}

/// [`Interpolation`] in the file.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) enum InterpolationCode {
    Barycentric,
    Cubic,
    Bicubic,
    Multiview,
}

/// [`SideInput`] in the file.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) enum SideInputCode {
    Barycentric,
    Cubic,
    Noise,
}

/// Both directions between a type and its code.
macro_rules! coded {
    ($type:ident, $code:ident, $($variant:ident),+) => {
        impl From<$type> for $code {
            fn from(value: $type) -> Self {
                match value { $($type::$variant => $code::$variant),+ }
            }
        }
        impl From<$code> for $type {
            fn from(code: $code) -> Self {
                match code { $($code::$variant => $type::$variant),+ }
            }
        }
    };
}

coded!(Storage, StorageCode, F32, I8);
coded!(Footprint, FootprintCode, Point, Lenslet, Grid);
coded!(SideInput, SideInputCode, Barycentric, Cubic, Noise);
coded!(Interpolation, InterpolationCode, Barycentric, Cubic, Bicubic, Multiview);

fn configuration() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<{ limits::HEADER }>()
}

/// The bytes of a header; those of networks only where there are any.
///
/// # Errors
/// The encoder's message.
pub(super) fn encode_header(header: &Header, networks: &[NetworkHeader]) -> Result<Vec<u8>, String> {
    let mut bytes = bincode::serde::encode_to_vec(header, configuration()).map_err(|e| e.to_string())?;
    if !networks.is_empty() {
        bytes.extend(bincode::serde::encode_to_vec(networks, configuration()).map_err(|e| e.to_string())?);
    }
    Ok(bytes)
}

/// Reads a header that takes all of `bytes`.
///
/// # Errors
/// A message that says what is wrong.
pub(super) fn decode_header(bytes: &[u8], with_networks: bool) -> Result<(Header, Vec<NetworkHeader>), String> {
    let unread = |e: bincode::error::DecodeError| format!("its header cannot be read ({e})");
    let (header, mut used): (Header, usize) =
        bincode::serde::decode_from_slice(bytes, configuration()).map_err(unread)?;
    let mut networks: Vec<NetworkHeader> = Vec::new();
    if with_networks {
        let more;
        (networks, more) = bincode::serde::decode_from_slice(&bytes[used..], configuration()).map_err(unread)?;
        used += more;
    }
    if used != bytes.len() {
        return Err("its header has bytes left over".into());
    }
    Ok((header, networks))
}
