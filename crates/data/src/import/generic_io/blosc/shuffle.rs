//! Elements whose bytes or bits were put together with those of the others at the same place: they come back one after the other. What is
//! behind the last whole element stays where it is.

/// Elements of `size` bytes of which there are first all first bytes, then all second ones, and so on.
pub(super) fn bytes_in_order(shuffled: &[u8], size: usize) -> Vec<u8> {
    let count = shuffled.len() / size;
    let mut elements = shuffled.to_vec();
    for (place, bytes) in shuffled[..count * size].chunks_exact(count.max(1)).enumerate() {
        for (to, byte) in elements[place..].iter_mut().step_by(size).zip(bytes) {
            *to = *byte;
        }
    }
    elements
}

/// Elements of `size` bytes of which there are first all lowest bits of the first bytes, eight to a byte from its lowest bit on, and so on.
/// Blosc leaves elements whose number 8 does not divide as they are.
pub(super) fn bits_in_order(shuffled: &[u8], size: usize) -> Vec<u8> {
    let count = shuffled.len() / size;
    let mut elements = shuffled.to_vec();
    if !count.is_multiple_of(8) {
        return elements;
    }
    let groups = count / 8;
    for place in 0..size {
        for group in 0..groups {
            let planes: [u8; 8] = std::array::from_fn(|bit| shuffled[(8 * place + bit) * groups + group]);
            let bytes = transposed(u64::from_le_bytes(planes)).to_le_bytes();
            for (to, byte) in elements[8 * group * size + place..].iter_mut().step_by(size).zip(bytes) {
                *to = byte;
            }
        }
    }
    elements
}

/// The bits of eight bytes, with bit `i` of byte `k` as bit `k` of byte `i` (Warren, "Hacker's Delight", 7-3).
fn transposed(mut bits: u64) -> u64 {
    for (distance, mask) in [(7, 0x00aa_00aa_00aa_00aa), (14, 0x0000_cccc_0000_cccc), (28, 0x0000_0000_f0f0_f0f0)] {
        let moved = (bits ^ (bits >> distance)) & mask;
        bits ^= moved ^ (moved << distance);
    }
    bits
}
