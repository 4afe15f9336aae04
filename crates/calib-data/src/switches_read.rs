//! Which channels of a log were read as switches.

use crate::{
    first_few::first_few,
    log::{ChannelValues, Log},
};

/// Returns those of `channels` that are pairs of words, each with its words; `values` are their values.
pub(crate) fn switches_in(log: &Log, channels: &[usize], values: &[ChannelValues]) -> Vec<String> {
    let pairs = channels.iter().zip(values).filter_map(|(&channel, values)| {
        values.not_numbers.switch.as_ref()?.told(&log.channels[channel].name)
    });
    pairs.collect()
}

/// Returns the message for channels that are pairs of words, each [with its words](calib_text::Switch::told);
/// `None` for no channels.
pub(crate) fn read_as_switches(channels: &[String]) -> Option<String> {
    let named = first_few(channels)?;
    Some(format!(
        "words are read as 1 and 0: {named}; preprocess.one_hot makes columns of the words of a channel instead"
    ))
}
