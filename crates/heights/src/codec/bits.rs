//! Bits, the highest of a byte first.

/// Appends bits to bytes.
#[derive(Debug)]
pub(super) struct BitWriter<'a> {
    out: &'a mut Vec<u8>,
    /// Bits that are no whole bytes yet, in the lowest places.
    held: u64,
    count: u32,
}

impl<'a> BitWriter<'a> {
    pub(super) fn new(out: &'a mut Vec<u8>) -> BitWriter<'a> {
        BitWriter { out, held: 0, count: 0 }
    }

    /// Appends the lowest `bits` (at most 32) of a value that has no others.
    #[inline(always)]
    pub(super) fn put(&mut self, value: u64, bits: u32) {
        self.held = (self.held << bits) | value;
        self.count += bits;
        if self.count >= 32 {
            self.count -= 32;
            let word = (self.held >> self.count) as u32;
            self.out.extend_from_slice(&word.to_be_bytes());
        }
    }

    /// The same for up to 64 bits.
    #[inline(always)]
    pub(super) fn put_long(&mut self, value: u64, bits: u32) {
        if bits > 32 {
            self.put(value >> 32, bits - 32);
            self.put(value & 0xffff_ffff, 32);
        } else {
            self.put(value, bits);
        }
    }

    /// Writes what is held, and zeros up to a whole byte.
    pub(super) fn finish(mut self) {
        let rest = (8 - self.count % 8) % 8;
        self.put(0, rest);
        while self.count >= 8 {
            self.count -= 8;
            self.out.push((self.held >> self.count) as u8);
        }
    }
}

/// Reads bits. After the end of the bytes there are zeros; [`BitReader::taken`] tells.
#[derive(Debug)]
pub(super) struct BitReader<'a> {
    bytes: &'a [u8],
    /// The next byte that is not in the window.
    next: usize,
    /// Bits to come, in the highest places; below them may be further ones.
    window: u64,
    count: u32,
}

impl<'a> BitReader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> BitReader<'a> {
        BitReader { bytes, next: 0, window: 0, count: 0 }
    }

    /// Makes at least 56 bits of the window right.
    #[inline(always)]
    pub(super) fn refill(&mut self) {
        let word = match self.bytes.get(self.next..self.next + 8) {
            Some(&[a, b, c, d, e, f, g, h]) => u64::from_be_bytes([a, b, c, d, e, f, g, h]),
            _ => self.last_word(),
        };
        self.window |= word >> self.count;
        self.next += ((63 - self.count) >> 3) as usize;
        self.count |= 56;
    }

    /// Eight bytes of which some are beyond the end.
    #[cold]
    fn last_word(&self) -> u64 {
        let mut word = [0; 8];
        let rest = self.bytes.get(self.next..).unwrap_or_default();
        let len = rest.len().min(8);
        word[..len].copy_from_slice(&rest[..len]);
        u64::from_be_bytes(word)
    }

    /// The bits to come, in the highest places: at least 56 right after a refill.
    #[inline(always)]
    pub(super) fn window(&self) -> u64 {
        self.window
    }

    /// Goes on by so many bits, which the window has.
    #[inline(always)]
    pub(super) fn skip(&mut self, bits: u32) {
        self.window <<= bits;
        self.count -= bits;
    }

    /// Reads up to 32 bits.
    #[inline(always)]
    pub(super) fn get(&mut self, bits: u32) -> u64 {
        if bits == 0 {
            return 0;
        }
        self.refill();
        let value = self.window >> (64 - bits);
        self.skip(bits);
        value
    }

    /// Reads up to 64 bits.
    #[inline(always)]
    pub(super) fn get_long(&mut self, bits: u32) -> u64 {
        match bits.checked_sub(32) {
            Some(high) => (self.get(high) << 32) | self.get(32),
            None => self.get(bits),
        }
    }

    /// How many bytes hold what was read: more than there are where some was read beyond the end.
    pub(super) fn taken(&self) -> usize {
        (8 * self.next).saturating_sub(self.count as usize).div_ceil(8)
    }
}
