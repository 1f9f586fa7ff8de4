//! Base64 as it is read. Codings that follow each other, each with its own end, are read as one.

use std::io::{Error, ErrorKind, Read, Result};

/// Decodes what another reader gives, up to the markup that follows it or its end; space between letters is left out.
pub(in crate::import) struct Base64<R> {
    inner: R,
    input: Vec<u8>,
    /// Decoded bytes that wait, and how many of them were given.
    output: Vec<u8>,
    given: usize,
    /// Bits that wait for more, how many letters they are of, and how many of these fill up.
    bits: u32,
    letters: u32,
    padding: u32,
    is_over: bool,
}

const BUFFER: usize = 1 << 16;

impl<R: Read> Base64<R> {
    pub(in crate::import) fn new(inner: R) -> Base64<R> {
        Base64 {
            inner,
            input: vec![0; BUFFER],
            output: Vec::new(),
            given: 0,
            bits: 0,
            letters: 0,
            padding: 0,
            is_over: false,
        }
    }

    /// Whether it ended with markup, not with what it reads from.
    pub(in crate::import) fn is_over(&self) -> bool {
        self.is_over
    }

    /// Decodes some more; false at the end.
    fn decode(&mut self) -> Result<bool> {
        let read = if self.is_over { 0 } else { self.inner.read(&mut self.input)? };
        if read == 0 {
            return if self.letters == 0 {
                Ok(false)
            } else {
                Err(Error::new(ErrorKind::UnexpectedEof, "base64 that ends too early"))
            };
        }
        self.output.clear();
        self.given = 0;
        for &letter in &self.input[..read] {
            let value = match letter {
                b'A'..=b'Z' => letter - b'A',
                b'a'..=b'z' => letter - b'a' + 26,
                b'0'..=b'9' => letter - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                b'=' if self.letters >= 2 => 0,
                _ if letter.is_ascii_whitespace() => continue,
                b'<' => {
                    self.is_over = true;
                    break;
                }
                _ => return Err(Error::new(ErrorKind::InvalidData, "a letter that is not base64")),
            };
            if letter != b'=' && self.padding > 0 {
                return Err(Error::new(ErrorKind::InvalidData, "base64 that goes on behind its end"));
            }
            self.padding += u32::from(letter == b'=');
            self.bits = self.bits << 6 | u32::from(value);
            self.letters += 1;
            if self.letters == 4 {
                let bytes = self.bits.to_be_bytes();
                self.output.extend_from_slice(&bytes[1..4 - self.padding as usize]);
                (self.bits, self.letters, self.padding) = (0, 0, 0);
            }
        }
        Ok(true)
    }
}

impl<R: Read> Read for Base64<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        while self.given == self.output.len() && !out.is_empty() {
            if !self.decode()? {
                return Ok(0);
            }
        }
        let count = out.len().min(self.output.len() - self.given);
        out[..count].copy_from_slice(&self.output[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(text: &str) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        Base64::new(text.as_bytes()).read_to_end(&mut bytes).map(|_| bytes)
    }

    #[test]
    fn codings_are_read_one_behind_the_other() {
        assert_eq!(decoded("aGVsbG8=").unwrap(), b"hello");
        assert_eq!(decoded("aGVs\n bG8=d29ybGQ=").unwrap(), b"helloworld");
        assert_eq!(decoded("//8=").unwrap(), [255, 255]);
        assert_eq!(decoded("aGVsbG8=</AppendedData>").unwrap(), b"hello");
        for wrong in ["aGV", "aGV<", "aG=V", "a===", "a*==", "=aaa"] {
            assert!(decoded(wrong).is_err(), "{wrong}");
        }
    }
}
