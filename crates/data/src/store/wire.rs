//! Primitive values as little-endian bytes, for footers and directories: writing appends, reading checks every length first.

use super::error::Damage;
use glam::DVec3;

/// Appends values.
#[derive(Default)]
pub struct Encoder {
    /// What was appended.
    pub bytes: Vec<u8>,
}

impl Encoder {
    /// Appends one byte.
    pub fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    /// Appends four bytes.
    pub fn u32(&mut self, value: u32) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// Appends eight bytes.
    pub fn u64(&mut self, value: u64) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// Appends a double.
    pub fn f64(&mut self, value: f64) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// Appends three doubles.
    pub fn vec3(&mut self, value: DVec3) {
        value.to_array().into_iter().for_each(|v| self.f64(v));
    }

    /// An optional double: a byte 0 or 1, then the value (0 where there is none).
    pub fn option_f64(&mut self, value: Option<f64>) {
        self.u8(u8::from(value.is_some()));
        self.f64(value.unwrap_or(0.0));
    }

    /// Text: its length in bytes as `u32`, then UTF-8.
    pub fn text(&mut self, text: &str) {
        self.u32(text.len() as u32);
        self.bytes.extend_from_slice(text.as_bytes());
    }

    /// A column of singles, without its length.
    pub fn f32s(&mut self, values: &[f32]) {
        self.bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }
}

/// Reads values off the front of a slice.
pub struct Decoder<'a> {
    rest: &'a [u8],
    /// What messages call the bytes.
    place: &'static str,
}

impl<'a> Decoder<'a> {
    /// At the beginning of `bytes`; `place` is what messages call them.
    pub fn new(bytes: &'a [u8], place: &'static str) -> Decoder<'a> {
        Decoder { rest: bytes, place }
    }

    fn damage(&self, expected: impl Into<String>) -> Damage {
        Damage::new(self.place, expected)
    }

    /// Takes so many bytes off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn bytes(&mut self, len: usize, field: &str) -> Result<&'a [u8], Damage> {
        let (head, rest) = self.rest.split_at_checked(len).ok_or_else(|| self.damage(format!("room for {field}")))?;
        self.rest = rest;
        Ok(head)
    }

    /// Takes bytes of a length that is known off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N], Damage> {
        let bytes = self.bytes(N, field)?;
        bytes.try_into().map_err(|_| self.damage(format!("room for {field}")))
    }

    /// Takes one byte off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn u8(&mut self, field: &str) -> Result<u8, Damage> {
        self.array::<1>(field).map(|[byte]| byte)
    }

    /// Takes four bytes off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn u32(&mut self, field: &str) -> Result<u32, Damage> {
        self.array(field).map(u32::from_le_bytes)
    }

    /// Takes eight bytes off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn u64(&mut self, field: &str) -> Result<u64, Damage> {
        self.array(field).map(u64::from_le_bytes)
    }

    /// Takes a double off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn f64(&mut self, field: &str) -> Result<f64, Damage> {
        self.array(field).map(f64::from_le_bytes)
    }

    /// Takes a single off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn f32(&mut self, field: &str) -> Result<f32, Damage> {
        self.array(field).map(f32::from_le_bytes)
    }

    /// Takes three doubles off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn vec3(&mut self, field: &str) -> Result<DVec3, Damage> {
        Ok(DVec3::new(self.f64(field)?, self.f64(field)?, self.f64(field)?))
    }

    /// Takes an optional double off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn option_f64(&mut self, field: &str) -> Result<Option<f64>, Damage> {
        let present = self.u8(field)?;
        let value = self.f64(field)?;
        match present {
            0 => Ok(None),
            1 => Ok(Some(value)),
            other => Err(self.damage(format!("{field} to be present (1) or absent (0), found {other}"))),
        }
    }

    /// Takes text off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn text(&mut self, field: &str) -> Result<String, Damage> {
        let len = self.u32(field)? as usize;
        let bytes = self.bytes(len, field)?;
        String::from_utf8(bytes.to_vec()).map_err(|_| self.damage(format!("{field} in UTF-8")))
    }

    /// A count of things that take at least `least` bytes each in what follows: never more than the bytes can hold.
    pub fn count(&mut self, least: usize, field: &str) -> Result<usize, Damage> {
        let count = self.u32(field)? as usize;
        match count.checked_mul(least) {
            Some(len) if len <= self.rest.len() => Ok(count),
            _ => Err(self.damage(format!("room for {count} {field}"))),
        }
    }

    /// Takes singles off.
    ///
    /// # Errors
    /// [`Damage`] where there is no room for `field`.
    pub fn f32s(&mut self, count: usize, field: &str) -> Result<Vec<f32>, Damage> {
        let len = count.checked_mul(4).ok_or_else(|| self.damage(format!("room for {field}")))?;
        let bytes = self.bytes(len, field)?;
        Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }

    /// Whether nothing is left.
    ///
    /// # Errors
    /// [`Damage`] where something is.
    pub fn finish(self) -> Result<(), Damage> {
        if self.rest.is_empty() { Ok(()) } else { Err(self.damage("an end after its last field")) }
    }
}
