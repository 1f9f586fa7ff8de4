//! The monitors of an X server as they are now. The window's own list is renewed only where the whole desktop changes its size, not
//! where a monitor in its middle is unplugged.

use super::placing::MonitorPlace;
use bevy::math::{IVec2, UVec2};
use x11rb::connection::Connection;
use x11rb::protocol::randr::ConnectionExt as _;
use x11rb::protocol::xproto::{ConnectionExt as _, Window};
use x11rb::rust_connection::RustConnection;

/// A connection to the server that the window is on.
pub(crate) struct Server {
    connection: RustConnection,
    root: Window,
}

impl Server {
    /// Connects to the server that the environment names; `None` where there is none.
    pub fn connect() -> Option<Server> {
        let (connection, screen) = RustConnection::connect(None).ok()?;
        let root = connection.setup().roots.get(screen)?.root;
        connection.randr_query_version(1, 5).ok()?.reply().ok()?;
        Some(Server { connection, root })
    }

    /// Its monitors, in its order; `None` where it does not say.
    pub fn places(&self) -> Option<Vec<MonitorPlace>> {
        let monitors = self.connection.randr_get_monitors(self.root, true).ok()?.reply().ok()?.monitors;
        let place = |monitor: &x11rb::protocol::randr::MonitorInfo| {
            let name = self.connection.get_atom_name(monitor.name).ok()?.reply().ok()?.name;
            Some(MonitorPlace {
                name: String::from_utf8_lossy(&name).into_owned(),
                corner: IVec2::new(monitor.x.into(), monitor.y.into()),
                size: UVec2::new(monitor.width.into(), monitor.height.into()),
            })
        };
        monitors.iter().map(place).collect()
    }
}
