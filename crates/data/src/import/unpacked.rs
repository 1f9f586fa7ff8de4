//! Pieces of a file that were unpacked last, for who reads on in them.

use super::ImportError;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes and pieces that are kept at most; the last two are whatever their size.
const KEPT: usize = 64 << 20;
const MOST: usize = 64;
const LEAST: usize = 2;

/// Unpacked pieces by their key.
pub(super) struct Unpacked<K> {
    /// The latest at the end.
    pieces: Mutex<Vec<(K, Arc<Vec<u8>>)>>,
}

impl<K> Default for Unpacked<K> {
    fn default() -> Unpacked<K> {
        Unpacked { pieces: Mutex::default() }
    }
}

impl<K: Copy + PartialEq> Unpacked<K> {
    /// The piece of a key, which `unpack` makes where it is not kept.
    ///
    /// # Errors
    /// What `unpack` says.
    pub(super) fn get(
        &self,
        key: K,
        unpack: impl FnOnce() -> Result<Vec<u8>, ImportError>,
    ) -> Result<Arc<Vec<u8>>, ImportError> {
        // Pieces are whole whatever a thread that holds the list does.
        let kept = || self.pieces.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(piece) = latest(&mut kept(), key) {
            return Ok(piece);
        }
        let piece = Arc::new(unpack()?);
        let mut list = kept();
        if latest(&mut list, key).is_none() {
            list.push((key, Arc::clone(&piece)));
            let mut bytes: usize = list.iter().map(|(_, piece)| piece.len()).sum();
            while list.len() > LEAST && (list.len() > MOST || bytes > KEPT) {
                bytes -= list.remove(0).1.len();
            }
        }
        Ok(piece)
    }
}

/// The piece of a key, which becomes the last one.
fn latest<K: PartialEq>(list: &mut [(K, Arc<Vec<u8>>)], key: K) -> Option<Arc<Vec<u8>>> {
    let at = list.iter().position(|(other, _)| *other == key)?;
    list[at..].rotate_left(1);
    list.last().map(|(_, piece)| Arc::clone(piece))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_pieces_are_kept() {
        let unpacked = Unpacked::default();
        let made = |key: usize, bytes: usize| {
            let mut is_made = false;
            let piece = unpacked.get(key, || {
                is_made = true;
                Ok(vec![key as u8; bytes])
            });
            assert_eq!(piece.unwrap().first(), Some(&(key as u8)));
            is_made
        };
        assert!((0..MOST).all(|key| made(key, 1)));
        assert!((0..MOST).all(|key| !made(key, 1)));
        // The first was asked for last but for those behind it.
        assert!(!made(0, 1) && made(MOST, 1) && !made(0, 1) && made(1, 1));
        // Two stay, though they are larger than all that is kept.
        assert!(made(200, KEPT) && made(201, KEPT) && !made(200, 1) && !made(201, 1) && made(0, 1));
    }

    #[test]
    fn what_cannot_be_unpacked_is_not_kept() {
        let unpacked = Unpacked::default();
        let wrong = || Err(ImportError::missing("file".as_ref(), "piece", "one"));
        assert!(unpacked.get(1, wrong).is_err());
        assert_eq!(*unpacked.get(1, || Ok(vec![7])).unwrap(), [7]);
    }
}
