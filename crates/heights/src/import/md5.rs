//! MD5 (RFC 1321), which X3P states of its parts.

/// The digest of what is put in piece by piece.
pub(crate) struct Md5 {
    state: [u32; 4],
    length: u64,
    pending: Vec<u8>,
}

/// Left rotations of the four rounds.
const TURNS: [[u32; 4]; 4] = [[7, 12, 17, 22], [5, 9, 14, 20], [4, 11, 16, 23], [6, 10, 15, 21]];

impl Md5 {
    /// Of nothing yet.
    pub(crate) fn new() -> Md5 {
        Md5 { state: [0x6745_2301, 0xefcd_ab89, 0x98ba_dcfe, 0x1032_5476], length: 0, pending: Vec::new() }
    }

    /// Puts in more bytes.
    pub(crate) fn put(&mut self, bytes: &[u8]) {
        self.length = self.length.wrapping_add(bytes.len() as u64);
        self.pending.extend_from_slice(bytes);
        let (blocks, rest) = self.pending.as_chunks::<64>();
        for block in blocks {
            turn(&mut self.state, block);
        }
        self.pending = rest.to_vec();
    }

    /// The digest in hexadecimal digits.
    pub(crate) fn digest(mut self) -> String {
        let bits = self.length.wrapping_mul(8);
        let zeros = (119 - self.pending.len() % 64) % 64;
        self.put(&[0x80]);
        self.put(&vec![0; zeros]);
        self.put(&bits.to_le_bytes());
        self.state.iter().flat_map(|word| word.to_le_bytes()).map(|byte| format!("{byte:02x}")).collect()
    }
}

/// Takes one block into the state.
fn turn(state: &mut [u32; 4], block: &[u8; 64]) {
    let mut words = [0; 16];
    for (word, bytes) in words.iter_mut().zip(block.as_chunks::<4>().0) {
        *word = u32::from_le_bytes(*bytes);
    }
    let [mut a, mut b, mut c, mut d] = *state;
    for step in 0..64 {
        let (mixed, word) = match step / 16 {
            0 => ((b & c) | (!b & d), step),
            1 => ((d & b) | (!d & c), 5 * step + 1),
            2 => (b ^ c ^ d, 3 * step + 5),
            _ => (c ^ (b | !d), 7 * step),
        };
        // The integer part of 2^32 |sin(step + 1)|.
        let sine = (libm::sin((step + 1) as f64).abs() * 4_294_967_296.0) as u32;
        let sum = a.wrapping_add(mixed).wrapping_add(words[word % 16]).wrapping_add(sine);
        (a, d, c) = (d, c, b);
        b = b.wrapping_add(sum.rotate_left(TURNS[step / 16][step % 4]));
    }
    for (word, more) in state.iter_mut().zip([a, b, c, d]) {
        *word = word.wrapping_add(more);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_are_those_of_the_standard() {
        let of = |text: &str, piece: usize| {
            let mut digest = Md5::new();
            text.as_bytes().chunks(piece).for_each(|piece| digest.put(piece));
            digest.digest()
        };
        let long = "1234567890".repeat(8);
        for piece in [1, 7, 64, 1000] {
            assert_eq!(of("", piece), "d41d8cd98f00b204e9800998ecf8427e");
            assert_eq!(of("abc", piece), "900150983cd24fb0d6963f7d28e17f72");
            assert_eq!(of(&long, piece), "57edf4a22be3c955ac49da2e2107b67a");
            assert_eq!(of(&"a".repeat(55), piece).len(), 32);
        }
    }
}
