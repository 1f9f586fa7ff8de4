"""Writes the folder `blosc`: the same numbers in containers of Blosc, by c-blosc itself but for those of Snappy, which its packages leave out, and
two files in the layout of HACC's GenericIO whose arrays are compressed as `GenericIO.cxx` does it. Needs blosc, and cramjam for Snappy. What is
in them, `crates/data/src/import/generic_io/blosc/tests.rs` and `tests/processor/import/generic_io.rs` say again."""

import os
import struct

import blosc
import cramjam

# Two blocks of 512 numbers and one of 400, with 3 bytes behind them, where blocks are not split; else one block of all numbers, and these 3 bytes.
BLOCK, LENGTH = 2048, 5699


def content(length):
    numbers = b"".join(struct.pack("<I", i % 32 * 1000 + i // 256) for i in range(length // 4 + 1))
    return numbers[:length]


def shuffled(block):
    """The first bytes of all numbers, the second ones, and so on, and what is behind the last number."""
    whole = len(block) // 4 * 4
    return b"".join(block[byte:whole:4] for byte in range(4)) + block[whole:]


def snappy(length):
    """Blocks that are not split."""
    blocks = [shuffled(content(length)[start : start + BLOCK]) for start in range(0, length, BLOCK)]
    packed = [bytes(cramjam.snappy.compress_raw(block)) for block in blocks]
    starts, at = b"", 16 + 4 * len(packed)
    for block in packed:
        starts += struct.pack("<i", at)
        at += 4 + len(block)
    head = struct.pack("<4BIII", 2, 1, 2 << 5 | 0x10 | 1, 4, length, BLOCK, at)
    return head + starts + b"".join(struct.pack("<i", len(block)) + block for block in packed)


def containers():
    shuffles = {"plain": blosc.NOSHUFFLE, "bytes": blosc.SHUFFLE, "bits": blosc.BITSHUFFLE}
    blosc.set_blocksize(BLOCK)
    for codec in ["blosclz", "lz4", "lz4hc", "zlib", "zstd"]:
        for name, shuffle in shuffles.items():
            yield f"{codec}-{name}", blosc.compress(content(LENGTH), 4, 9, shuffle, codec)
    # Blocks that are split have 64 KiB or more: two of them, and the rest.
    yield "blocks", blosc.compress(content(2 * 65536 + 1603), 4, 9, blosc.SHUFFLE, "blosclz")
    # A block with a number of numbers that 8 does not divide.
    yield "odd-bits", blosc.compress(content(LENGTH + 4), 4, 9, blosc.BITSHUFFLE, "lz4")
    yield "copied", blosc.compress(content(100), 4, 0, blosc.SHUFFLE, "lz4")
    yield "snappy-bytes", snappy(LENGTH)


def checksum(data):
    total = 2**64 - 1
    for byte in data:
        total ^= byte
        for _ in range(8):
            total = total >> 1 ^ (0xC96C5795D7870F42 if total & 1 else 0)
    return total ^ 2**64 - 1


def generic_io(order):
    """Particles of three processes, of which the first are too few to be compressed, and the second has none."""
    words = lambda *numbers: struct.pack(f"{order}{len(numbers)}Q", *numbers)
    closed = lambda data: data + struct.pack("<Q", checksum(data) ^ 2**64 - 1)
    variables = [(name, 1, "f", lambda i, k=k: i * (k + 1) / 4) for k, name in enumerate(["x", "y", "z", "vx", "vy", "vz"])]
    variables += [("id", 2, "q", lambda i: 2**60 + i), ("mask", 0, "H", lambda i: i % 4)]
    counts = [5, 0, 1500]
    blosc.set_blocksize(0)
    header_length = 168 + len(variables) * 280 + len(counts) * 48 + len(counts) * len(variables) * 48
    ranks, blocks, arrays, first, at = b"", b"", b"", 0, header_length + 8
    for rank, count in enumerate(counts):
        ranks += words(rank, 0, 0, count, at, rank)
        for _, _, kind, value in variables:
            size = struct.calcsize(f"={kind}")
            plain = struct.pack(f"{order}{count}{kind}", *(value(i) for i in range(first, first + count)))
            packed = blosc.compress(plain, size, 9, blosc.SHUFFLE, "blosclz") if plain else b""
            # The library gives up where the container does not fit into the array's own room.
            is_packed = 0 < len(packed) <= len(plain)
            array = words(checksum(plain)) + packed if is_packed else plain
            blocks += (b"BLOSC" if is_packed else b"").ljust(32, b"\0") + words(at, len(array))
            arrays += closed(array)
            at += len(array) + 8
        first += count
    header = (b"HACC01L\0" if order == "<" else b"HACC01B\0") + words(header_length, first, len(counts), 1, 1)
    header += words(len(variables), 280, 168, len(counts), 48, 168 + len(variables) * 280, 168)
    header += struct.pack(f"{order}6d", 0, 0, 0, 2048, 2048, 2048)
    header += words(48, 168 + len(variables) * 280 + len(counts) * 48)
    for name, flags, kind, _ in variables:
        size = struct.calcsize(f"={kind}")
        header += name.encode().ljust(256, b"\0") + words(flags, size, size)
    return closed(header + ranks + blocks) + arrays


def main():
    os.makedirs("blosc", exist_ok=True)
    files = [(f"{name}.blosc", data) for name, data in containers()]
    files += [("little.gio", generic_io("<")), ("big.gio", generic_io(">"))]
    for name, data in files:
        with open(f"blosc/{name}", "wb") as file:
            file.write(data)


main()
