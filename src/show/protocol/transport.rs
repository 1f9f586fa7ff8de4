//! Sockets under netcode and renet: who may be heard at all.
//!
//! Netcode encrypts and authenticates every packet with keys that are made anew for each meeting and are exchanged under the show's
//! key; renet makes messages of packets, some of which arrive surely and in order. What a socket brings is looked at before netcode
//! does: packets that no netcode of any kind sends are dropped here, because that library takes the length of their numbers as
//! they say, and those that ask to be let in are not heard from who is in already, because they would count as a sign of life.

use super::{MOST_FOLLOWERS, ShowKey};
use renet::{Bytes, ChannelConfig, ClientId, ConnectionConfig, RenetClient, RenetServer, SendType, ServerEvent};
use renetcode::{
    ClientAuthentication, ConnectToken, DisconnectReason, NETCODE_MAX_PACKET_BYTES, NetcodeClient, NetcodeServer,
    ServerAuthentication, ServerConfig, ServerResult, generate_random_bytes,
};
use std::collections::HashMap;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::Duration;

/// What arrives or does not, and the latest counts.
pub(super) const UNRELIABLE: u8 = 0;
/// What arrives in order.
pub(super) const RELIABLE: u8 = 1;

/// What both sides call what they speak.
const PROTOCOL: u64 = u64::from_le_bytes(*b"deepfld1");
/// Seconds without a sign of life after which the other side is gone.
const SILENCE_SECS: i32 = 5;
/// Seconds that a token holds: for ever, because the clocks of machines that have no other network are wrong. It opens nothing to
/// who has only recorded it: the keys in it are under the show's key.
const TOKEN_SECS: u64 = 1 << 40;
/// The leader's address in tokens: it is the same for all, because a leader does not know by which of its addresses it is reached.
const NOMINAL: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 1);
/// Packets that are taken in at a time, so that a flood does not stop the picture.
const MOST_PACKETS: usize = 4096;
/// Challenges without an answer after which a leader that nobody follows forgets them.
const MOST_CHALLENGES: usize = 2048;
/// Bytes in the reliable channel that are not acknowledged, at most.
const MOST_BACKLOG: usize = 16 << 20;

fn channels() -> ConnectionConfig {
    let channel =
        |channel_id, max_memory_usage_bytes, send_type| ChannelConfig { channel_id, max_memory_usage_bytes, send_type };
    let reliable = || SendType::ReliableOrdered { resend_time: Duration::from_millis(100) };
    ConnectionConfig {
        available_bytes_per_tick: 120_000,
        server_channels_config: vec![
            channel(UNRELIABLE, 1 << 18, SendType::Unreliable),
            channel(RELIABLE, MOST_BACKLOG, reliable()),
        ],
        client_channels_config: vec![
            channel(UNRELIABLE, 1 << 18, SendType::Unreliable),
            channel(RELIABLE, 1 << 18, reliable()),
        ],
    }
}

/// Time that passes at once at most: while a program itself stands still, nobody else is silent.
const MOST_PASSED: Duration = Duration::from_secs(1);

/// Kinds of packets by the lower half of their first byte.
const REQUEST: u8 = 0;
/// Bytes of a request to be let in.
const REQUEST_BYTES: usize = 1 + 13 + 8 + 8 + 24 + 1024;

/// Whether netcode may look at a packet: its number is as long as it says, is one that a meeting can reach, and a seal can follow.
fn is_sound(packet: &[u8]) -> bool {
    let Some(&prefix) = packet.first() else { return false };
    if prefix & 0xf == REQUEST {
        return packet.len() == REQUEST_BYTES;
    }
    let length = usize::from(prefix >> 4);
    // Six bytes count the frames of a million years.
    prefix & 0xf <= 6 && length <= 6 && packet.len() >= 1 + length + 16
}

fn is_request(packet: &[u8]) -> bool {
    packet.first().is_some_and(|prefix| prefix & 0xf == REQUEST)
}

/// The next packet of a socket that does not block; what an earlier packet has caused at the other side is no error of this one.
fn receive(socket: &UdpSocket, buffer: &mut [u8]) -> Option<(usize, SocketAddr)> {
    for _ in 0..16 {
        match socket.recv_from(buffer) {
            Ok(packet) => return Some(packet),
            Err(error) if error.kind() == ErrorKind::WouldBlock => return None,
            Err(_) => {}
        }
    }
    None
}

/// Sends a packet; where the network does not take it, it is lost as any other may be.
fn send(socket: &UdpSocket, packet: &[u8], address: SocketAddr) {
    let _lost = socket.send_to(packet, address);
}

/// The clients that are connected.
#[derive(Default)]
struct Guests {
    addresses: HashMap<SocketAddr, ClientId>,
    /// Those who have not said anything yet, and when they may be sent messages again. They understand nothing before netcode has told
    /// them that they are in, and where that is lost it is said again only to whom nothing else was sent for a while.
    new: HashMap<ClientId, Duration>,
}

/// Pause between messages to one who has not said anything yet: long enough for netcode to say in between that they are in.
const NEW_PAUSE: Duration = Duration::from_millis(400);

/// The leader's socket.
pub(super) struct ServerSide {
    socket: UdpSocket,
    key: ShowKey,
    netcode: NetcodeServer,
    renet: RenetServer,
    now: Duration,
    guests: Guests,
    challenges: usize,
    buffer: Box<[u8; NETCODE_MAX_PACKET_BYTES]>,
}

fn server(key: &ShowKey) -> NetcodeServer {
    NetcodeServer::new(ServerConfig {
        current_time: Duration::ZERO,
        max_clients: MOST_FOLLOWERS,
        protocol_id: PROTOCOL,
        public_addresses: vec![NOMINAL],
        authentication: ServerAuthentication::Secure { private_key: *key.bytes() },
    })
}

impl ServerSide {
    /// A socket at that address.
    pub(super) fn bind(address: SocketAddr, key: ShowKey) -> std::io::Result<ServerSide> {
        let socket = UdpSocket::bind(address)?;
        socket.set_nonblocking(true)?;
        Ok(ServerSide {
            socket,
            netcode: server(&key),
            key,
            renet: RenetServer::new(channels()),
            now: Duration::ZERO,
            guests: Guests::default(),
            challenges: 0,
            buffer: Box::new([0; NETCODE_MAX_PACKET_BYTES]),
        })
    }

    pub(super) fn address(&self) -> std::io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Takes in what has come until `now`, which never goes back. Who has come and gone.
    pub(super) fn receive(&mut self, now: Duration) -> Vec<ServerEvent> {
        let passed = now.saturating_sub(self.now).min(MOST_PASSED);
        self.now = self.now.max(now);
        self.renet.update(passed);
        self.netcode.update(passed);
        for _ in 0..MOST_PACKETS {
            let Some((length, from)) = receive(&self.socket, &mut self.buffer[..]) else { break };
            let packet = &mut self.buffer[..length];
            if !is_sound(packet) || (is_request(packet) && self.guests.addresses.contains_key(&from)) {
                continue;
            }
            let asks = is_request(packet);
            let result = self.netcode.process_packet(from, packet);
            if asks && matches!(result, ServerResult::PacketToSend { .. }) {
                self.challenges += 1;
            }
            take(result, &self.socket, &mut self.renet, &mut self.guests);
        }
        for client in self.netcode.clients_id() {
            take(self.netcode.update_client(client), &self.socket, &mut self.renet, &mut self.guests);
        }
        for client in self.renet.disconnections_id() {
            take(self.netcode.disconnect(client), &self.socket, &mut self.renet, &mut self.guests);
        }
        if self.challenges > MOST_CHALLENGES && self.guests.addresses.is_empty() {
            self.netcode = server(&self.key);
            self.challenges = 0;
        }
        std::iter::from_fn(|| self.renet.get_event()).collect()
    }

    /// The next message of a follower.
    pub(super) fn message(&mut self, client: ClientId, channel: u8) -> Option<Bytes> {
        self.renet.receive_message(client, channel)
    }

    /// Where a follower is.
    pub(super) fn address_of(&self, client: ClientId) -> Option<SocketAddr> {
        self.netcode.client_addr(client)
    }

    /// Seconds that a packet takes to a follower and back.
    pub(super) fn round_trip(&self, client: ClientId) -> f64 {
        self.renet.rtt(client)
    }

    /// Gives a follower a message; false where there is no room for it, so that it is to be tried again.
    pub(super) fn give(&mut self, client: ClientId, channel: u8, message: Bytes) -> bool {
        let room = self.renet.can_send_message(client, channel, message.len());
        if room {
            self.renet.send_message(client, channel, message);
        }
        room
    }

    /// Whether everything that was given to a follower has arrived, or little has not.
    pub(super) fn has_room(&self, client: ClientId) -> bool {
        MOST_BACKLOG - self.renet.channel_available_memory(client, RELIABLE).min(MOST_BACKLOG) < 1 << 17
    }

    /// Ends a meeting.
    pub(super) fn dismiss(&mut self, client: ClientId) {
        self.renet.disconnect(client);
    }

    /// Sends what was given.
    pub(super) fn send(&mut self) {
        for client in self.renet.clients_id() {
            if let Some(next) = self.guests.new.get_mut(&client) {
                if self.now < *next {
                    continue;
                }
                *next = self.now + NEW_PAUSE;
            }
            for packet in self.renet.get_packets_to_send(client).unwrap_or_default() {
                if let Ok((address, packet)) = self.netcode.generate_payload_packet(client, &packet) {
                    send(&self.socket, packet, address);
                }
            }
        }
    }
}

impl Drop for ServerSide {
    fn drop(&mut self) {
        // Followers need not wait for a silence.
        for client in self.netcode.clients_id() {
            take(self.netcode.disconnect(client), &self.socket, &mut self.renet, &mut self.guests);
        }
    }
}

/// Carries out what a packet means.
fn take(result: ServerResult<'_, '_>, socket: &UdpSocket, renet: &mut RenetServer, guests: &mut Guests) {
    match result {
        ServerResult::None => {}
        ServerResult::PacketToSend { addr, payload } => send(socket, payload, addr),
        ServerResult::Payload { client_id, payload } => {
            guests.new.remove(&client_id);
            // Packets of clients that are not known any more are dropped.
            let _gone = renet.process_packet_from(payload, client_id);
        }
        ServerResult::ClientConnected { client_id, addr, payload, .. } => {
            guests.addresses.insert(addr, client_id);
            guests.new.insert(client_id, Duration::ZERO);
            renet.add_connection(client_id);
            send(socket, payload, addr);
        }
        ServerResult::ClientDisconnected { client_id, addr, payload } => {
            guests.addresses.remove(&addr);
            guests.new.remove(&client_id);
            renet.remove_connection(client_id);
            if let Some(payload) = payload {
                send(socket, payload, addr);
            }
        }
    }
}

/// A follower's socket, for one attempt and the meeting that comes of it.
pub(super) struct ClientSide {
    socket: UdpSocket,
    leader: SocketAddr,
    netcode: NetcodeClient,
    renet: RenetClient,
    now: Duration,
    buffer: Box<[u8; NETCODE_MAX_PACKET_BYTES]>,
}

impl ClientSide {
    /// Begins to ask a leader to be let in.
    pub(super) fn new(now: Duration, leader: SocketAddr, key: &ShowKey) -> std::io::Result<ClientSide> {
        let any: IpAddr = if leader.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
        // A socket of its own for each attempt: netcode knows who is on the way in by the address.
        let socket = UdpSocket::bind(SocketAddr::new(any, 0))?;
        socket.set_nonblocking(true)?;
        let client = u64::from_le_bytes(generate_random_bytes());
        let (from, hosts) = (Duration::ZERO, vec![NOMINAL]);
        let token = ConnectToken::generate(from, PROTOCOL, TOKEN_SECS, client, SILENCE_SECS, hosts, None, key.bytes())
            .map_err(|error| std::io::Error::other(error.to_string()))?;
        let netcode = NetcodeClient::new(from, ClientAuthentication::Secure { connect_token: token })
            .map_err(|error| std::io::Error::other(error.to_string()))?;
        let buffer = Box::new([0; NETCODE_MAX_PACKET_BYTES]);
        Ok(ClientSide { socket, leader, netcode, renet: RenetClient::new(channels()), now, buffer })
    }

    /// Takes in what has come until `now`.
    ///
    /// # Errors
    /// Why the attempt or the meeting is over.
    pub(super) fn receive(&mut self, now: Duration) -> Result<(), &'static str> {
        let passed = now.saturating_sub(self.now).min(MOST_PASSED);
        self.now = self.now.max(now);
        self.renet.update(passed);
        for _ in 0..MOST_PACKETS {
            let Some((length, _)) = receive(&self.socket, &mut self.buffer[..]) else { break };
            let packet = &mut self.buffer[..length];
            if !is_sound(packet) || is_request(packet) {
                continue;
            }
            if let Some(payload) = self.netcode.process_packet(packet) {
                self.renet.process_packet(payload);
            }
        }
        if let Some((packet, _)) = self.netcode.update(passed) {
            send(&self.socket, packet, self.leader);
        }
        if self.netcode.is_connected() {
            self.renet.set_connected();
        }
        if self.renet.is_disconnected() {
            return Err("what it sends makes no sense");
        }
        match self.netcode.disconnect_reason() {
            None => Ok(()),
            Some(DisconnectReason::DisconnectedByServer) => Err("it has ended or sent this one away"),
            Some(DisconnectReason::ConnectionDenied) => Err("it has as many followers as it can have"),
            Some(DisconnectReason::ConnectionTimedOut) => Err("nothing is heard of it"),
            Some(_) => Err(NO_ANSWER),
        }
    }

    /// The next message of the leader.
    pub(super) fn message(&mut self, channel: u8) -> Option<Bytes> {
        self.renet.receive_message(channel)
    }

    /// Gives the leader a message; one that there is no room for is lost.
    pub(super) fn give(&mut self, channel: u8, message: Vec<u8>) {
        if self.renet.can_send_message(channel, message.len()) {
            self.renet.send_message(channel, message);
        }
    }

    /// Seconds that a packet takes to the leader and back.
    pub(super) fn round_trip(&self) -> f64 {
        self.renet.rtt()
    }

    /// Sends what was given.
    pub(super) fn send(&mut self) {
        if !self.netcode.is_connected() {
            return;
        }
        for packet in self.renet.get_packets_to_send() {
            if let Ok((_, packet)) = self.netcode.generate_payload_packet(&packet) {
                send(&self.socket, packet, self.leader);
            }
        }
    }
}

/// An attempt to which nobody says a word.
pub(super) const NO_ANSWER: &str = "it does not answer";

impl Drop for ClientSide {
    fn drop(&mut self) {
        if self.netcode.is_connected()
            && let Ok((_, packet)) = self.netcode.disconnect()
        {
            send(&self.socket, packet, self.leader);
        }
    }
}

#[cfg(test)]
mod tests;
