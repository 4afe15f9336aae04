//! Parquet files that no library writes: any types, levels and declarations, right or wrong.

use polars_parquet_format::{
    ColumnChunk, ColumnMetaData, CompressionCodec, ConvertedType, DataPageHeader,
    DictionaryPageHeader, Encoding, FieldRepetitionType, FileMetaData, LogicalType, PageHeader,
    PageType, RowGroup, SchemaElement, Type, thrift::protocol::TCompactOutputProtocol,
};

/// Runs of equal levels: length and level.
pub(crate) type Levels = Vec<(u64, u8)>;

/// A column of values, inside its groups.
#[derive(Clone, Debug)]
pub(crate) struct Column {
    /// Names of the enclosing groups, their repetition, and their types.
    pub(crate) groups: Vec<(String, FieldRepetitionType, Option<ConvertedType>)>,
    pub(crate) name: String,
    pub(crate) physical: Type,
    /// Length in bytes of a value, for fixed-length types.
    pub(crate) length: Option<i32>,
    pub(crate) repetition: FieldRepetitionType,
    pub(crate) converted: Option<ConvertedType>,
    pub(crate) logical: Option<LogicalType>,
    /// Scale and precision of decimals.
    pub(crate) scale_and_precision: Option<(i32, i32)>,
    pub(crate) repetition_levels: Option<Levels>,
    pub(crate) definition_levels: Option<Levels>,
    /// Existing values in plain encoding; with a dictionary, its entries.
    pub(crate) plain: Vec<u8>,
    /// Number of dictionary entries. Every value is the first entry.
    pub(crate) dictionary: Option<i32>,
    /// Number of rows with and without a value.
    pub(crate) values: u64,
}

impl Column {
    /// Returns a column in which every row has a value.
    pub(crate) fn required(name: &str, physical: Type, plain: Vec<u8>, values: u64) -> Self {
        Self {
            groups: Vec::new(),
            name: name.to_owned(),
            physical,
            length: None,
            repetition: FieldRepetitionType::REQUIRED,
            converted: None,
            logical: None,
            scale_and_precision: None,
            repetition_levels: None,
            definition_levels: None,
            plain,
            dictionary: None,
            values,
        }
    }

    fn path(&self) -> Vec<String> {
        let groups = self.groups.iter().map(|(name, ..)| name.clone());
        groups.chain([self.name.clone()]).collect()
    }

    fn schema(&self) -> Vec<SchemaElement> {
        let leaf = SchemaElement {
            type_: Some(self.physical),
            type_length: self.length,
            repetition_type: Some(self.repetition),
            name: self.name.clone(),
            num_children: None,
            converted_type: self.converted,
            scale: self.scale_and_precision.map(|(scale, _)| scale),
            precision: self.scale_and_precision.map(|(_, precision)| precision),
            field_id: None,
            logical_type: self.logical.clone(),
        };
        self.groups.iter().map(schema_of_group).chain([leaf]).collect()
    }

    /// Returns the pages of the column, and the offset of its data page.
    fn pages(&self) -> (Vec<u8>, usize) {
        let mut bytes = Vec::new();
        let mut content = Vec::new();
        content.extend(self.repetition_levels.iter().flat_map(with_length));
        content.extend(self.definition_levels.iter().flat_map(with_length));
        let encoding = if let Some(entries) = self.dictionary {
            let header = DictionaryPageHeader {
                num_values: entries,
                encoding: Encoding::PLAIN,
                is_sorted: None,
            };
            page(&mut bytes, &self.plain, |page| {
                page.type_ = PageType::DICTIONARY_PAGE;
                page.dictionary_page_header = Some(header);
            });
            // There is one bit per value, and one run for all of them.
            content.push(1);
            content.extend(run(self.values, 0));
            Encoding::RLE_DICTIONARY
        } else {
            content.extend(&self.plain);
            Encoding::PLAIN
        };
        let start = bytes.len();
        page(&mut bytes, &content, |page| {
            page.data_page_header = Some(DataPageHeader {
                num_values: i32::try_from(self.values).unwrap_or(i32::MAX),
                encoding,
                definition_level_encoding: Encoding::RLE,
                repetition_level_encoding: Encoding::RLE,
                statistics: None,
            });
        });
        (bytes, start)
    }
}

fn page(bytes: &mut Vec<u8>, content: &[u8], set: impl FnOnce(&mut PageHeader)) {
    let size = content.len() as i32;
    let mut header = PageHeader {
        type_: PageType::DATA_PAGE,
        uncompressed_page_size: size,
        compressed_page_size: size,
        crc: None,
        data_page_header: None,
        index_page_header: None,
        dictionary_page_header: None,
        data_page_header_v2: None,
    };
    set(&mut header);
    let mut protocol = TCompactOutputProtocol::new(&mut *bytes);
    header.write_to_out_protocol(&mut protocol).expect("memory");
    bytes.extend(content);
}

/// Returns a group with one child.
fn schema_of_group(
    (name, repetition, converted): &(String, FieldRepetitionType, Option<ConvertedType>),
) -> SchemaElement {
    SchemaElement {
        type_: None,
        type_length: None,
        repetition_type: Some(*repetition),
        name: name.clone(),
        num_children: Some(1),
        converted_type: *converted,
        scale: None,
        precision: None,
        field_id: None,
        logical_type: None,
    }
}

/// Encodes a run of equal numbers of at most eight bits.
fn run(count: u64, value: u8) -> Vec<u8> {
    let mut header = count << 1;
    let mut bytes = Vec::new();
    while header >= 0x80 {
        bytes.push(header as u8 | 0x80);
        header >>= 7;
    }
    bytes.extend([header as u8, value]);
    bytes
}

fn with_length(levels: &Levels) -> Vec<u8> {
    let runs: Vec<u8> = levels.iter().flat_map(|&(count, value)| run(count, value)).collect();
    [&(runs.len() as u32).to_le_bytes()[..], &runs].concat()
}

/// Returns a file of one row group; `declare` may change its metadata.
pub(crate) fn file(
    columns: &[Column],
    rows: i64,
    declare: impl FnOnce(&mut FileMetaData),
) -> Vec<u8> {
    let mut bytes = b"PAR1".to_vec();
    let mut chunks = Vec::new();
    for column in columns {
        let (pages, data) = column.pages();
        let start = bytes.len();
        bytes.extend(&pages);
        let metadata = ColumnMetaData {
            type_: column.physical,
            encodings: vec![Encoding::PLAIN, Encoding::RLE, Encoding::RLE_DICTIONARY],
            path_in_schema: column.path(),
            codec: CompressionCodec::UNCOMPRESSED,
            num_values: column.values as i64,
            total_uncompressed_size: pages.len() as i64,
            total_compressed_size: pages.len() as i64,
            key_value_metadata: None,
            data_page_offset: (start + data) as i64,
            index_page_offset: None,
            dictionary_page_offset: column.dictionary.map(|_| start as i64),
            statistics: None,
            encoding_stats: None,
            bloom_filter_offset: None,
            bloom_filter_length: None,
            size_statistics: None,
        };
        chunks.push(ColumnChunk {
            file_path: None,
            file_offset: start as i64,
            meta_data: Some(metadata),
            offset_index_offset: None,
            offset_index_length: None,
            column_index_offset: None,
            column_index_length: None,
            crypto_metadata: None,
            encrypted_column_metadata: None,
        });
    }
    let root = SchemaElement {
        type_: None,
        type_length: None,
        repetition_type: None,
        name: "schema".to_owned(),
        num_children: Some(columns.len() as i32),
        converted_type: None,
        scale: None,
        precision: None,
        field_id: None,
        logical_type: None,
    };
    let mut metadata = FileMetaData {
        version: 1,
        schema: [root].into_iter().chain(columns.iter().flat_map(Column::schema)).collect(),
        num_rows: rows,
        row_groups: vec![RowGroup {
            columns: chunks,
            total_byte_size: bytes.len() as i64,
            num_rows: rows,
            sorting_columns: None,
            file_offset: None,
            total_compressed_size: None,
            ordinal: None,
        }],
        key_value_metadata: None,
        created_by: None,
        column_orders: None,
        encryption_algorithm: None,
        footer_signing_key_metadata: None,
    };
    declare(&mut metadata);
    let start = bytes.len();
    let mut protocol = TCompactOutputProtocol::new(&mut bytes);
    metadata.write_to_out_protocol(&mut protocol).expect("memory");
    let length = (bytes.len() - start) as u32;
    bytes.extend(length.to_le_bytes());
    bytes.extend(b"PAR1");
    bytes
}
