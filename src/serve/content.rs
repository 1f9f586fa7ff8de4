//! What answers carry: bytes that are there, or a part of a file, which is read as the other end takes it.

use crate::model::ReadFile;
use hyper::body::{Body, Bytes, Frame, SizeHint};
use std::io;
use std::ops::Range;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use tokio::task::{JoinHandle, spawn_blocking};

/// Bytes of a file that are read at a time.
const CHUNK: u64 = 256 << 10;

/// The content of an answer.
pub(super) enum Content {
    /// Bytes.
    Whole(Bytes),
    /// A part of a file.
    Part(Part),
}

/// What is left to send of a part of a file; at most one chunk of it is in memory.
pub(super) struct Part {
    file: Arc<ReadFile>,
    range: Range<u64>,
    reading: Option<JoinHandle<io::Result<Bytes>>>,
}

impl Content {
    /// A part of a file.
    pub(super) fn part(file: Arc<ReadFile>, range: Range<u64>) -> Content {
        Content::Part(Part { file, range, reading: None })
    }

    fn remaining(&self) -> u64 {
        match self {
            Content::Whole(bytes) => bytes.len() as u64,
            Content::Part(part) => part.range.end.saturating_sub(part.range.start),
        }
    }
}

impl Part {
    fn poll(&mut self, context: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        if self.range.is_empty() {
            return Poll::Ready(None);
        }
        let (file, range) = (&self.file, &self.range);
        let reading = self.reading.get_or_insert_with(|| {
            let (file, from) = (Arc::clone(file), range.start);
            let count = CHUNK.min(range.end - range.start) as usize;
            spawn_blocking(move || {
                let mut bytes = vec![0; count];
                file.read_exact_at(&mut bytes, from)?;
                Ok(Bytes::from(bytes))
            })
        });
        let read = ready!(Pin::new(reading).poll(context));
        self.reading = None;
        Poll::Ready(Some(match read {
            Ok(Ok(bytes)) => {
                self.range.start += bytes.len() as u64;
                Ok(Frame::data(bytes))
            }
            Ok(Err(error)) => Err(error),
            Err(error) => Err(io::Error::other(error)),
        }))
    }
}

impl Body for Content {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        match self.get_mut() {
            Content::Whole(bytes) if bytes.is_empty() => Poll::Ready(None),
            Content::Whole(bytes) => Poll::Ready(Some(Ok(Frame::data(std::mem::take(bytes))))),
            Content::Part(part) => part.poll(context),
        }
    }

    fn is_end_stream(&self) -> bool {
        self.remaining() == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.remaining())
    }
}
