//! Ids of rows, in all of their bits.

use super::{file, gzip, ids_of, values};
use deepfield_data::import::{FieldKind, open};
use proptest::prelude::*;

/// Bytes in base64 (RFC 4648).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let four = |three: &[u8]| -> String {
        let byte = |at: usize| three.get(at).map_or(0, |byte| u32::from(*byte));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        let letter =
            |at: usize| if at > three.len() { '=' } else { LETTERS[(bits >> (18 - 6 * at)) as usize % 64] as char };
        (0..4).map(letter).collect()
    };
    bytes.chunks(3).map(four).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Ids have all of their 64 bits however they are written, by whichever usual name, alone and in parts of one table.
    #[test]
    fn ids_keep_all_their_bits(
        name in prop::sample::select(vec!["id", "source_id", "objid", "OBJECT_ID", "objectId", "Source ID"]),
        ids in prop::collection::vec(prop_oneof![any::<u64>(), 0..9_u64, (1_u64 << 53) - 4..(1_u64 << 53) + 4], 5..40),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let signed: Vec<u64> = ids.iter().map(|id| id >> 1).collect();
        let rows = |ids: &[u64]| ids.iter().map(|id| format!("1,{id},2,3\n")).collect::<String>();
        let header = format!("x,{name},y,z\n");
        let parts = folder.join("parts");
        std::fs::create_dir(&parts).unwrap();
        file(&parts, "0.csv", (header.clone() + &rows(&ids[..3])).as_bytes());
        file(&parts, "1.csv.gz", &gzip((header.clone() + &rows(&ids[3..])).as_bytes()));
        // A line for each column.
        let ones = vec!["1"; ids.len()].join(",");
        let words = ids.iter().map(u64::to_string).collect::<Vec<_>>().join(",");
        let column = |name: &str, kind: &str| format!("# - {{name: '{name}', datatype: {kind}}}\n");
        let columns = [column("x", "float64"), column(name, "uint64"), column("y", "float64"), column("z", "float64")];
        let described = format!("# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n{}", columns.concat());
        let places = ids.iter().map(|id| {
            format!("{{\"geometry\": {{\"coordinates\": [1, 2]}}, \"properties\": {{\"{name}\": {id}}}}}")
        });
        let places = places.collect::<Vec<_>>().join(",");
        let field = |name: &str, kind: &str| format!("<FIELD name='{name}' datatype='{kind}'/>");
        let fields = [field("x", "double"), field(name, "long"), field("y", "double"), field("z", "double")].concat();
        let votable =
            |data: &str| format!("<VOTABLE><RESOURCE><TABLE>{fields}<DATA>{data}</DATA></TABLE></RESOURCE></VOTABLE>");
        let cells = signed.iter().map(|id| match id % 3 {
            0 => format!("<TR><TD>1</TD><TD>{id:#x}</TD><TD>2</TD><TD>3</TD></TR>"),
            _ => format!("<TR><TD>1</TD><TD>{id}</TD><TD>2</TD><TD>3</TD></TR>"),
        });
        let bytes = signed.iter().flat_map(|id| [1_f64.to_bits(), *id, 0, 0].map(u64::to_be_bytes));
        let bytes = base64(&bytes.flatten().collect::<Vec<u8>>());
        let stream = format!("<BINARY><STREAM encoding='base64'>{bytes}</STREAM></BINARY>");
        let cases = [
            ("rows.csv", header.clone() + &rows(&ids), &ids),
            ("lines.csv", format!("{header}{ones}\n{words}\n{ones}\n{ones}\n"), &ids),
            ("rows.ecsv", described + &header + &rows(&ids), &ids),
            ("places.json", format!("{{\"type\": \"FeatureCollection\", \"features\": [{places}]}}"), &ids),
            ("cells.vot", votable(&format!("<TABLEDATA>{}</TABLEDATA>", cells.collect::<String>())), &signed),
            ("bytes.vot", votable(&stream), &signed),
        ];
        for (path, text, expected) in &cases {
            assert_eq!(&ids_of(&file(folder, path, text.as_bytes())), *expected, "{path}");
        }
        assert_eq!(ids_of(&parts), ids);
        // Where a row has none, rows cannot be asked for by them; the others are numbers all the same.
        let source = open(&file(folder, "gap.csv", format!("{header}{}1,,2,3\n", rows(&ids)).as_bytes())).unwrap();
        let about = source.description();
        assert_eq!(about.families[0].find(FieldKind::Id), None);
        let told = format!("{name} is no id, as it is not a whole number in every row");
        assert!(about.notes.contains(&told) && values(&*source, name)[0] == ids[0] as f64, "{:?}", about.notes);
    }
}
