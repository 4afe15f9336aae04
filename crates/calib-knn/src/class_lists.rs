use std::ops::Range;

use calib_core::TransitionIndex;

use crate::{
    Queries,
    candidate_mask::CandidateMask,
    lists::{Candidate, Lists},
};

/// The nearest sources of one query in every class and every member that the query belongs to.
///
/// Each class has one list for all members: the shortest one that contains as many sources of each member as are requested. A candidate
/// is then inserted once, instead of once per member.
#[derive(Clone, Debug, Default)]
pub(crate) struct ClassLists {
    k: usize,
    /// The members from which sources are requested.
    wanted: Vec<usize>,
    /// The number of members of the ensemble.
    members: usize,
    /// The most candidates of a class.
    room: usize,
    /// The candidates of each class, in order: `[class, room]`.
    listed: Vec<Listed>,
    /// The number of sources that are requested, `[class, member]`.
    requested: Vec<u32>,
    /// The length of a list that contains as many of the member as are requested, `[class, member]`: those that are requested, and
    /// those of the list that the member lacks.
    needed: Vec<u32>,
    extents: Vec<ClassListExtent>,
    /// The largest radius.
    radius: f64,
}

/// The length and the radius of the list of one class.
#[derive(Clone, Copy, Debug)]
struct ClassListExtent {
    count: usize,
    radius: f64,
}

#[derive(Clone, Copy, Debug)]
struct Listed {
    candidate: Candidate,
    /// The members that lack the candidate.
    first_lacking: u32,
    end_lacking: u32,
}

impl Listed {
    const NONE: Self = Self { candidate: Candidate::NONE, first_lacking: 0, end_lacking: 0 };

    fn lacking(self) -> Range<usize> {
        self.first_lacking as usize..self.end_lacking as usize
    }

    fn is_in(self, member: usize) -> bool {
        !self.lacking().contains(&member)
    }
}

/// The list of one class.
struct ClassList<'a> {
    listed: &'a mut [Listed],
    requested: &'a [u32],
    needed: &'a mut [u32],
    extent: &'a mut ClassListExtent,
}

impl ClassList<'_> {
    /// Inserts a candidate that is within the radius.
    fn insert(&mut self, new: Listed) {
        let was_full = self.extent.radius < f64::INFINITY;
        if was_full && self.listed[self.extent.count - 1].candidate.before(new.candidate) {
            return;
        }
        if self.extent.count == self.listed.len() {
            self.discard();
        }
        let mut position = self.extent.count;
        while position > 0 && new.candidate.before(self.listed[position - 1].candidate) {
            self.listed[position] = self.listed[position - 1];
            position -= 1;
        }
        self.listed[position] = new;
        self.extent.count += 1;
        self.needed[new.lacking()].iter_mut().for_each(|needed| *needed += 1);
        let count = self.extent.count as u32;
        if was_full || self.needed.iter().all(|&needed| count >= needed) {
            self.shorten();
        }
    }

    /// Removes the last candidates of a full list as long as it is full without them, and sets the radius.
    fn shorten(&mut self) {
        loop {
            let last = self.listed[self.extent.count - 1];
            let rest = self.extent.count as u32 - 1;
            let (before, others) = self.needed.split_at_mut(last.first_lacking as usize);
            let (lacking, after) = others.split_at_mut(last.lacking().len());
            if before.iter().chain(&*after).any(|&needed| rest < needed) {
                self.extent.radius = last.candidate.squared;
                return;
            }
            self.extent.count -= 1;
            for needed in lacking {
                *needed -= 1;
            }
        }
    }

    /// Removes the candidates that no member needs, as when most are in the block that one member lacks.
    #[cold]
    fn discard(&mut self) {
        let mut found = vec![0; self.requested.len()];
        self.needed.copy_from_slice(self.requested);
        let mut kept = 0;
        for position in 0..self.extent.count {
            let listed = self.listed[position];
            let mut needed = false;
            for (member, (found, requested)) in found.iter_mut().zip(self.requested).enumerate() {
                if listed.is_in(member) && *found < *requested {
                    *found += 1;
                    needed = true;
                }
            }
            if needed {
                self.listed[kept] = listed;
                kept += 1;
                self.needed[listed.lacking()].iter_mut().for_each(|needed| *needed += 1);
            }
        }
        self.extent.count = kept;
    }
}

impl ClassLists {
    fn class(&mut self, class: usize) -> ClassList<'_> {
        let members = class * self.members..(class + 1) * self.members;
        ClassList {
            listed: &mut self.listed[class * self.room..][..self.room],
            requested: &self.requested[members.clone()],
            needed: &mut self.needed[members],
            extent: &mut self.extents[class],
        }
    }

    fn update_radius(&mut self) {
        let radii = self.extents.iter().map(|extent| extent.radius);
        self.radius = radii.fold(f64::NEG_INFINITY, f64::max);
    }
}

impl Lists for ClassLists {
    const BY_CLASS: bool = true;

    fn requested(queries: &Queries<'_>, query: usize, k: usize) -> Self {
        let members = queries.members();
        let classes = queries.classes().count();
        let mut wanted: Vec<usize> = queries.wanted(query).collect();
        let mut requested = vec![0; classes * members];
        for class in queries.wanted_classes(query) {
            for member in &wanted {
                requested[class * members + member] = k as u32;
            }
        }
        if let Some((class, member)) = queries.wanted_nearest(query) {
            requested[class * members + member] = 1;
            wanted.push(member);
        }
        // A member lacks up to k + 2 candidates that others need: k of its block, and those that two members lack. Then follow k
        // that it has.
        let room = 2 * k + 4;
        let mut lists = Self {
            k,
            wanted,
            members,
            room,
            listed: vec![Listed::NONE; classes * room],
            needed: requested.clone(),
            requested,
            extents: vec![ClassListExtent { count: 0, radius: 0.0 }; classes],
            radius: 0.0,
        };
        lists.clear();
        lists
    }

    fn clear(&mut self) {
        self.needed.copy_from_slice(&self.requested);
        for (extent, requested) in self.extents.iter_mut().zip(self.requested.chunks(self.members))
        {
            let any = requested.iter().any(|&requested| requested > 0);
            let radius = if any { f64::INFINITY } else { f64::NEG_INFINITY };
            *extent = ClassListExtent { count: 0, radius };
        }
        self.update_radius();
    }

    fn offer(&mut self, class: usize, candidate: Candidate, findable: CandidateMask<'_>) {
        let before = self.extents[class].radius;
        if candidate.squared > before {
            return;
        }
        let Range { start, end } = findable.lacking(candidate.transition);
        let new = Listed { candidate, first_lacking: start as u32, end_lacking: end as u32 };
        self.class(class).insert(new);
        if before == self.radius {
            self.update_radius();
        }
    }

    fn radius(&self) -> f64 {
        self.radius
    }

    fn radius_in(&self, class: usize) -> f64 {
        self.extents[class].radius
    }

    fn k(&self) -> usize {
        self.k
    }

    fn members(&self) -> &[usize] {
        &self.wanted
    }

    fn all(&self) -> impl Iterator<Item = TransitionIndex> + '_ {
        let lists = self.listed.chunks(self.room.max(1)).zip(&self.extents);
        let found = lists.flat_map(|(listed, extent)| &listed[..extent.count]);
        found.map(|listed| TransitionIndex(listed.candidate.transition))
    }

    fn each(&self, mut put: impl FnMut(usize, usize, Candidate)) {
        for (class, extent) in self.extents.iter().enumerate() {
            let listed = &self.listed[class * self.room..][..extent.count];
            for member in 0..self.members {
                let list = class * self.members + member;
                let requested = self.requested[list] as usize;
                let found = listed.iter().filter(|listed| listed.is_in(member)).take(requested);
                for (position, listed) in found.enumerate() {
                    put(list, position, listed.candidate);
                }
            }
        }
    }
}
