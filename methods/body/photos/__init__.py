"""What the body fit takes from photos: landmarks, masks and working views."""
