//! What copies of pages stand for: tables of their codebooks, a set for each column that a picture resamples by itself.

use super::content_look::table_of_column;
use super::depiction::entries;
use super::page_copies::item;
use super::scene::{ParticleScene, TableId};
use super::view::DrawItem;
use crate::codec::Codebook;
use crate::cpu::volume::attributes::Column;
use crate::mode::{Depiction, Plan};
use crate::picture::decode::reach;
use crate::store::{FamilyMetadata, Metadata};
use crate::stream::SceneNode;
use crate::view::{Extent, View};

/// A table for each family and codebook, and its largest importance.
type Tables = Vec<Vec<(TableId, f32)>>;

/// The tables of a depiction, of each column that its pictures may resample by itself; of other pictures than those of fields there is one.
#[derive(Default)]
pub struct ColumnTables(Vec<(Column, Tables)>);

impl ColumnTables {
    /// Makes them.
    pub fn new(scene: &ParticleScene, depiction: &Depiction, metadata: &Metadata) -> ColumnTables {
        let fields = depiction.mode.technique.fields(&depiction.settings).len();
        let attribute = (fields == 0 || depiction.attribute.is_some()).then_some(Column::Attribute);
        let of_column = |column: Column| {
            let of_family = |family: &FamilyMetadata| {
                let of_book = |book: &Codebook| {
                    let table = table_of_column(depiction.table(family, book), column);
                    (scene.insert_table(entries(&table)), table.most_important)
                };
                family.codebooks.iter().map(of_book).collect::<Vec<_>>()
            };
            (column, metadata.families.iter().map(of_family).collect())
        };
        ColumnTables((0..fields).map(Column::Field).chain(attribute).map(of_column).collect())
    }

    /// Takes them away.
    pub fn free(self, scene: &ParticleScene) {
        let tables = self.0.into_iter().flat_map(|(_, tables)| tables).flatten();
        tables.for_each(|(table, _)| scene.remove_table(table));
    }

    /// The largest importance in each family's codebooks, which is the same for all columns.
    pub fn most_important(&self) -> Vec<Vec<f32>> {
        let first = self.0.first().map_or(&[][..], |(_, tables)| tables.as_slice());
        first.iter().map(|books| books.iter().map(|(_, most_important)| *most_important).collect()).collect()
    }

    /// What is drawn of nodes that are selected for a view, the sample that `plan` says, and how far it reaches: all of it with each of the
    /// columns, one column after the other. `source` tells open files apart.
    pub fn items(
        &self,
        columns: &[Column],
        nodes: &[SceneNode],
        (source, view): (u32, &View),
        wanted: (&Depiction, &Metadata, &Plan),
    ) -> (Vec<DrawItem>, Vec<Extent>) {
        let of_column = |column: &Column| self.0.iter().find(|(known, _)| known == column);
        let with_tables = |(_, tables): &(Column, Tables)| {
            let with_extent = |drawn: &SceneNode| {
                let item = item(source, drawn, view, wanted, tables)?;
                Some((item, reach(drawn, item.sample.growth)))
            };
            nodes.iter().filter_map(with_extent).collect::<Vec<_>>()
        };
        columns.iter().filter_map(of_column).flat_map(with_tables).unzip()
    }
}
