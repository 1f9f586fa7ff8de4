use super::*;
use proptest::prelude::*;

const STEP: Duration = Duration::from_millis(16);

/// A leader's side and a follower's that are in a meeting.
struct Meeting {
    server: ServerSide,
    client: ClientSide,
    now: Duration,
}

impl Meeting {
    fn new() -> Meeting {
        let key = ShowKey::random();
        let server = ServerSide::bind("127.0.0.1:0".parse().unwrap(), key.clone()).unwrap();
        let client = ClientSide::new(Duration::ZERO, server.address().unwrap(), &key).unwrap();
        let mut meeting = Meeting { server, client, now: Duration::ZERO };
        for _ in 0..20 {
            meeting.step();
        }
        assert_eq!(meeting.server.guests.addresses.len(), 1, "they meet");
        meeting
    }

    fn step(&mut self) {
        self.now += STEP;
        self.client.receive(self.now).unwrap();
        self.client.send();
        self.server.receive(self.now);
        self.server.send();
    }

    fn leader(&self) -> SocketAddr {
        self.server.address().unwrap()
    }

    fn follower(&self) -> SocketAddr {
        *self.server.guests.addresses.keys().next().unwrap()
    }

    /// Still in the meeting: a message arrives each way.
    fn works(&mut self) {
        let id = self.server.guests.addresses.values().copied().next().unwrap();
        self.client.give(RELIABLE, b"up".to_vec());
        assert!(self.server.give(id, RELIABLE, Bytes::from_static(b"down")));
        self.step();
        self.step();
        assert_eq!(self.server.message(id, RELIABLE).as_deref(), Some(&b"up"[..]));
        assert_eq!(self.client.message(RELIABLE).as_deref(), Some(&b"down"[..]));
        assert!(self.server.message(id, RELIABLE).is_none() && self.client.message(RELIABLE).is_none());
    }
}

/// Packets that a stranger may make up: of every kind, with numbers of every length, and none of them sealed.
fn strange() -> Vec<Vec<u8>> {
    let mut packets = vec![Vec::new(), vec![0; REQUEST_BYTES], vec![0; 1500], vec![0xff; 1400]];
    for prefix in 0..=255u8 {
        for length in [1, 2, 17, 18, 19, 33, 300, REQUEST_BYTES] {
            for fill in [0, 0x7f, 0xff] {
                let mut packet = vec![fill; length];
                packet[0] = prefix;
                packets.push(packet);
            }
        }
    }
    packets
}

#[test]
fn strange_packets_from_the_addresses_of_both_change_nothing() {
    let mut meeting = Meeting::new();
    let (leader, follower) = (meeting.leader(), meeting.follower());
    let third = UdpSocket::bind("127.0.0.1:0").unwrap();
    for (i, packet) in strange().iter().enumerate() {
        // As somebody would who gives a wrong address.
        send(&meeting.client.socket, packet, leader);
        send(&meeting.server.socket, packet, follower_address(follower));
        send(&third, packet, leader);
        if i % 16 == 0 {
            meeting.step();
        }
    }
    meeting.step();
    assert_eq!(meeting.server.guests.addresses.len(), 1);
    meeting.works();
}

/// The socket listens at any address of the machine; on this one it is reached by the loopback.
fn follower_address(address: SocketAddr) -> SocketAddr {
    SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), address.port())
}

#[test]
fn requests_are_no_sign_of_life() {
    let mut meeting = Meeting::new();
    let (leader, mut gone) = (meeting.leader(), false);
    let mut request = vec![7; REQUEST_BYTES];
    request[0] = REQUEST;
    for _ in 0..600 {
        meeting.now += STEP;
        send(&meeting.client.socket, &request, leader);
        let events = meeting.server.receive(meeting.now);
        gone |= events.iter().any(|event| matches!(event, ServerEvent::ClientDisconnected { .. }));
    }
    assert!(gone, "a follower that says nothing is gone, whoever speaks in its name");
}

#[test]
fn another_key_is_not_answered() {
    let mut server = ServerSide::bind("127.0.0.1:0".parse().unwrap(), ShowKey::random()).unwrap();
    let mut client = ClientSide::new(Duration::ZERO, server.address().unwrap(), &ShowKey::random()).unwrap();
    let mut now = Duration::ZERO;
    let over = (0..1000).find_map(|_| {
        now += STEP;
        let over = client.receive(now).err();
        assert!(server.receive(now).is_empty() && server.challenges == 0);
        over
    });
    assert_eq!(over, Some(NO_ANSWER));
}

#[test]
fn a_program_that_stood_still_has_not_heard_a_silence() {
    let mut meeting = Meeting::new();
    meeting.now += Duration::from_secs(60);
    meeting.step();
    meeting.works();
}

/// All that goes over the wire between two, written down by somebody in the middle.
struct Tapped {
    server: ServerSide,
    client: ClientSide,
    middle: UdpSocket,
    client_address: Option<SocketAddr>,
    to_leader: Vec<Vec<u8>>,
    to_follower: Vec<Vec<u8>>,
    /// How many times that it is in is lost on the way to the follower.
    loses: usize,
    now: Duration,
}

impl Tapped {
    fn new() -> Tapped {
        let key = ShowKey::random();
        let middle = UdpSocket::bind("127.0.0.1:0").unwrap();
        middle.set_nonblocking(true).unwrap();
        let server = ServerSide::bind("127.0.0.1:0".parse().unwrap(), key.clone()).unwrap();
        let client = ClientSide::new(Duration::ZERO, middle.local_addr().unwrap(), &key).unwrap();
        let (to_leader, to_follower) = (Vec::new(), Vec::new());
        Tapped { server, client, middle, client_address: None, to_leader, to_follower, loses: 0, now: Duration::ZERO }
    }

    fn pass_on(&mut self) {
        let (leader, mut buffer) = (self.server.address().unwrap(), [0; 2000]);
        while let Some((length, from)) = receive(&self.middle, &mut buffer) {
            let packet = buffer[..length].to_vec();
            if from == leader && packet[0] & 0xf == KEEP_ALIVE && self.loses > 0 {
                self.loses -= 1;
            } else if from == leader {
                send(&self.middle, &packet, self.client_address.unwrap());
                self.to_follower.push(packet);
            } else {
                self.client_address = Some(from);
                send(&self.middle, &packet, leader);
                self.to_leader.push(packet);
            }
        }
    }

    fn step(&mut self) {
        self.now += STEP;
        self.client.receive(self.now).unwrap();
        self.client.send();
        self.pass_on();
        self.server.receive(self.now);
        self.server.send();
        self.pass_on();
    }
}

/// Netcode's word that a follower is in, and that it still is.
const KEEP_ALIVE: u8 = 4;

#[test]
fn who_misses_that_they_are_in_is_told_again_within_a_second() {
    let mut tapped = Tapped::new();
    tapped.loses = 2;
    let mut told = false;
    for _ in 0..62 {
        tapped.step();
        // Something that has to arrive, and is sent again and again.
        if let Some(client) = tapped.server.guests.addresses.values().next().copied().filter(|_| !told) {
            told = tapped.server.give(client, RELIABLE, Bytes::from_static(b"welcome"));
        }
        if tapped.client.message(RELIABLE).is_some() {
            assert_eq!(tapped.loses, 0);
            return;
        }
    }
    panic!("nothing arrives, connected: {}", tapped.client.netcode.is_connected());
}

proptest! {
    #![proptest_config(crate::cases::cases(12))]
    /// Packets of a real meeting that come again, or damaged, or cut, at either side: everything arrives once and as it was.
    #[test]
    fn packets_that_come_again_or_damaged_change_nothing(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 1..=255u8), 200),
    ) {
        let mut tapped = Tapped::new();
        let (mut said, mut told, mut up, mut down) = (0u8, 0u8, 0u8, 0u8);
        let mut damage = damage.into_iter();
        for _ in 0..60 {
            tapped.step();
            let clients: Vec<ClientId> = tapped.server.guests.addresses.values().copied().collect();
            for &client in &clients {
                tapped.server.give(client, RELIABLE, Bytes::from(vec![told]));
                told += 1;
                while let Some(message) = tapped.server.message(client, RELIABLE) {
                    prop_assert_eq!(&message[..], &[up]);
                    up += 1;
                }
            }
            while let Some(message) = tapped.client.message(RELIABLE) {
                prop_assert_eq!(&message[..], &[down]);
                down += 1;
            }
            if tapped.client.netcode.is_connected() {
                tapped.client.give(RELIABLE, vec![said]);
                said += 1;
            }
            if tapped.client_address.is_none() {
                continue;
            }
            let (leader, follower) = (tapped.server.address().unwrap(), tapped.client_address.unwrap());
            for (packets, to) in [(&tapped.to_leader, leader), (&tapped.to_follower, follower)] {
                let Some((which, at, change)) = damage.next().filter(|_| !packets.is_empty()) else { continue };
                let packet = &packets[which.index(packets.len())];
                // Once more as it was, which is no news.
                send(&tapped.middle, packet, to);
                let mut damaged = packet.clone();
                let place = at.index(damaged.len());
                damaged[place] ^= change;
                send(&tapped.middle, &damaged, to);
                send(&tapped.middle, &packet[..place], to);
            }
        }
        prop_assert!(tapped.server.guests.addresses.len() == 1 && up > 40 && down > 40, "{up} {down}");
    }
}
