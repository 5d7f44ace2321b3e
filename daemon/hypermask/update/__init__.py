"""Upgrades by .deb: install, keep, roll back, and hand a running show over to the new code.

Four things are kept apart, so that a power cut in any of them leaves a show that starts:

* dpkg changes the installed files (`install`); a boot ends what it began (debian/libexec/repair);
* the packages are kept where a rollback finds them (`shelf`);
* a running show goes on with its own copy of the code until nobody looks (`takeover`, `idle`);
* what the user made is put aside before, for a version that cannot read it (`userdata`).
"""
